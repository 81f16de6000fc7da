//! Frames from any bytes, as programs and boards exchange them and as they never would, and a recording of them.
#![allow(dead_code, reason = "each target uses a part of it")]

use ecmsk::compare::TimedFrame;
use ecmsk::link::Dir;
use ecmsk::sk::{Frame, MasterResponse, MasterState, RawSlot, SlotSize, StateByte};

/// Bytes of a step.
const STEP: usize = 16;
/// Frames of an input at most: a model lives through the time between them.
const FRAMES_MAX: usize = 300;
/// Bits of a time that flip: so many seconds that no silence is as long.
const FLIPS: [u32; 4] = [43, 50, 62, 63];

/// The frames that steps of 16 bytes tell: what is done, where, how much later, and a slot. Times are those that a file has.
pub fn frames(bytes: &[u8], size: SlotSize) -> Vec<TimedFrame> {
    let (mut command, mut report) = (Frame::new(), Frame::new());
    let mut found: Vec<TimedFrame> = Vec::new();
    let mut at_ns: i64 = 1_000_000_000;
    let mut flipped = false;
    for step in bytes.chunks_exact(STEP).take(4 * FRAMES_MAX) {
        let [what, place, low, high, ..] = *step else { break };
        let slot = slot(&step[4..]);
        let at = usize::from(place) % size.slots();
        at_ns += i64::from(u16::from_le_bytes([low, high])) * 1000;
        let passed = match what % 8 {
            0 => Some((Dir::Write, command.clone())),
            1 => Some((Dir::Read, report.clone())),
            2 => {
                command.put(size, at, &slot);
                None
            }
            3 => {
                report.put(size, at, &slot);
                None
            }
            4 => {
                command = Frame::new();
                None
            }
            5 => {
                let states = [MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op];
                let board = MasterResponse {
                    id: 0xBF,
                    state: StateByte::reached(states[usize::from(place) % states.len()]),
                    fifo_free: u16::from(step[4]),
                    ..MasterResponse::default()
                };
                report.put(size, 0, &board.encode());
                Some((Dir::Read, report.clone()))
            }
            6 => Some((Dir::Write, Frame::from_prefix(step))),
            // Late, or with a bit of its time flipped.
            _ => Some((if place & 1 == 0 { Dir::Write } else { Dir::Read }, command.clone())),
        };
        let Some((dir, mut frame)) = passed else { continue };
        if what & 0x80 != 0 {
            frame.fill_crc(size);
        }
        let odd = what % 8 == 7 && !found.is_empty();
        // Two in a row would be a clock that was set: an hour, which takes a model longer than an input may.
        flipped = odd && place & 2 != 0 && !flipped;
        let at_ns = match (odd, flipped) {
            (true, false) => at_ns - i64::from(step[4]) * 100_000,
            (true, true) => at_ns ^ (1 << FLIPS[usize::from(step[4]) % FLIPS.len()]),
            _ => at_ns,
        };
        found.push(TimedFrame { number: found.len() as u64 + 1, at_ns, dir, frame });
        if found.len() == FRAMES_MAX {
            break;
        }
    }
    if flipped {
        found.pop();
    }
    found
}

/// The frames in the order of their times, as a run to compare has them.
pub fn run(bytes: &[u8], size: SlotSize) -> Vec<TimedFrame> {
    let mut frames = frames(bytes, size);
    frames.sort_by_key(|observed| observed.at_ns);
    frames
}

/// The slot of twelve bytes.
pub fn slot(bytes: &[u8]) -> RawSlot {
    let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    RawSlot {
        id: bytes[0],
        index: bytes[1],
        parm: u16::from_le_bytes([bytes[2], bytes[3]]),
        data1: word(4),
        data2: word(8),
        ..RawSlot::ZERO
    }
}

/// A recording of ours with these frames; `link`: what it says its link is, `ends`: whether it was ended.
pub fn recording(link: &str, frames: &[TimedFrame], ends: bool) -> Vec<u8> {
    let comment = format!("ecmsk clock=virtual base_ns=0 link={link}");
    let mut section = Vec::new();
    section.extend(0x1A2B_3C4D_u32.to_le_bytes());
    section.extend([1, 0, 0, 0]);
    section.extend(u64::MAX.to_le_bytes());
    option(&mut section, 1, comment.as_bytes());
    option(&mut section, 4, b"ecmsk 0.0.0");
    option(&mut section, 0, b"");
    let mut interface = vec![220, 0, 0, 0, 0, 0, 0, 0];
    option(&mut interface, 9, &[9]);
    option(&mut interface, 0, b"");
    let mut file = Vec::new();
    block(&mut file, 0x0A0D_0D0A, &section);
    block(&mut file, 1, &interface);
    for TimedFrame { at_ns, dir, frame, .. } in frames {
        let (event, endpoint) = if *dir == Dir::Write { (b'S', 0x02) } else { (b'C', 0x81) };
        let mut packet = vec![0; 8];
        packet.extend([event, 1, endpoint, 1, 1, 0, b'-', 0]);
        packet.extend([0; 16]);
        packet.extend(512_u32.to_le_bytes());
        packet.extend(512_u32.to_le_bytes());
        packet.extend([0; 24]);
        packet.extend(frame.bytes());
        let time = *at_ns as u64;
        let mut body = vec![0; 4];
        for word in [(time >> 32) as u32, time as u32, packet.len() as u32, packet.len() as u32] {
            body.extend(word.to_le_bytes());
        }
        body.extend(packet);
        block(&mut file, 6, &body);
    }
    if ends {
        block(&mut file, 5, &[0; 12]);
    }
    file
}

fn option(body: &mut Vec<u8>, code: u16, value: &[u8]) {
    body.extend(code.to_le_bytes());
    body.extend((value.len() as u16).to_le_bytes());
    body.extend(value);
    body.resize(body.len().next_multiple_of(4), 0);
}

fn block(file: &mut Vec<u8>, kind: u32, body: &[u8]) {
    let length = (body.len() as u32 + 12).to_le_bytes();
    file.extend(kind.to_le_bytes());
    file.extend(length);
    file.extend(body);
    file.extend(length);
}
