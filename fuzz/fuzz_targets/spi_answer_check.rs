//! Exchanges on SPI with a modelled board, over wires that fault or do not: whatever the board answers is taken for an answer, a
//! flipped bit in one with a CRC never is, wires that are stuck or that slip are named, and the pacer lives through it all.

#![no_main]

#[path = "support/board.rs"]
mod board;
#[path = "support/frames.rs"]
mod frames;

use ecmsk::engine::{Board, Firmware};
use ecmsk::link::spi::{
    AnswerCheck, ExchangeContent, InvalidAnswer, Pacer, PacerOptions, PacerPlan, WaitingFrames, WiringFault,
};
use ecmsk::sk::{CrcPolicy, CycleTime, FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState, SlotSize};
use libfuzzer_sys::fuzz_target;

/// Exchanges of an input at most: a model lives through the time between them.
const EXCHANGES_MAX: u32 = 1000;
/// Bytes of a step.
const STEP: usize = 16;
/// The longest time that a pacer may wait: a cycle, and those that it passes over. The longest cycle is 1 s.
const WAIT_MAX_NS: u64 = 10_000_000_000;

fuzz_target!(|bytes: &[u8]| {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let mut wires = Wires::new(kind);
    let mut frame = Frame::new();
    for step in bytes.chunks_exact(STEP) {
        let place = usize::from(step[1]);
        match step[0] % 8 {
            0 => frame = Frame::new(),
            1 => frame.put(wires.size, place % wires.size.slots(), &frames::slot(&step[4..])),
            2 => frame = wires.set_up(step[1]),
            3 => wires.host(&frame),
            // Exchanges, the same damage to each.
            4..=6 => {
                (0..=step[1] % 64).for_each(|_| wires.exchange(Damage::of(step)));
                if wires.left > 0 {
                    wires.name(Damage::of(step));
                }
            }
            _ => {
                // Any bytes at all: if they are an answer, their CRC or their form is right.
                let answer = Frame::from_prefix(step);
                let fills = wires.answer_check.fills_crc();
                let taken = wires.answer_check.check(&answer);
                let is_right = answer.check_crc(wires.size, CrcPolicy::Strict).is_ok();
                assert!(taken.is_err() || is_right || !fills && answer.crc_byte() == 0);
                assert!(taken.is_ok() || !wires.answer_check.explain().to_string().is_empty());
                wires.bad = if taken.is_ok() { Bad::None } else { Bad::Mixed };
                wires.lucky += u32::from(taken.is_ok() && answer.crc_byte() != 0);
            }
        }
    }
});

/// What becomes of an answer on the wires.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Damage {
    None,
    Flipped { bit: usize },
    Stuck(u8),
    Slipped { bits: usize, late: bool },
    Echo,
    Burst { at: usize, pattern: u64 },
}

impl Damage {
    fn of(step: &[u8]) -> Self {
        let number = usize::from(u16::from_le_bytes([step[3], step[4]]));
        match step[2] % 8 {
            0..=2 => Self::None,
            3 => Self::Flipped { bit: number },
            4 => Self::Stuck(if number & 1 == 0 { 0 } else { 0xFF }),
            5 => Self::Slipped { bits: 1 + number / 2 % 40, late: number & 1 == 0 },
            6 => Self::Echo,
            _ => Self::Burst {
                at: number,
                pattern: u64::from_le_bytes([step[5], step[6], step[7], step[8], step[9], 0, 0, 0]),
            },
        }
    }
}

/// Answers that were none.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Bad {
    None,
    /// All have slipped by so many bits, and lost nothing but zeros.
    Late(usize),
    Mixed,
}

/// The wires, and both ends of them.
struct Wires {
    board: Board,
    size: SlotSize,
    fills_crc: bool,
    answer_check: AnswerCheck,
    pacer: Pacer,
    now: u64,
    newest: Frame,
    /// Frames of the host that the link holds.
    held: Vec<Frame>,
    left: u32,
    /// The answers that were none since one that was.
    bad: Bad,
    /// Answers of the wires' own making that were taken for ones with a CRC.
    lucky: u32,
}

impl Wires {
    fn new(kind: u8) -> Self {
        let size = if kind & 1 == 0 { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
        let (mut board, _) = board::board(size, Firmware::V17);
        let mut newest = Frame::new();
        board.cycle(&mut |report, _| newest.clone_from(report));
        let prefill = [0, 0, 8, 40][usize::from(kind >> 2 & 3)];
        let pacer = Pacer::new(PacerOptions {
            slot: size,
            cycle: CycleTime::DEFAULT,
            prefill,
            period_ns: if kind & 16 == 0 { 0 } else { 300_000 },
            wires_ns: 200_000,
        });
        let answer_check = AnswerCheck::new(size);
        let (now, held, fills_crc) = (board.now(), Vec::new(), kind & 2 == 0);
        Self {
            board,
            size,
            fills_crc,
            answer_check,
            pacer,
            now,
            newest,
            held,
            left: EXCHANGES_MAX,
            bad: Bad::None,
            lucky: 0,
        }
    }

    /// A frame of those that bring a network up, or take it down.
    fn set_up(&self, which: u8) -> Frame {
        let [axes, op, on] = board::set_up(self.size, which >> 3);
        let mut state = Frame::new();
        let target = [MasterState::Init, MasterState::PreOp, MasterState::SafeOp][usize::from(which) % 3];
        state.put_master(self.size, &MasterCommand::SetState(target));
        match which % 8 {
            0 => axes,
            1 => op,
            2 => on,
            _ => state,
        }
    }

    /// The program writes a frame.
    fn host(&mut self, frame: &Frame) {
        if self.held.len() < 200 {
            self.held.insert(0, frame.clone());
        }
    }

    /// One exchange, when it is due.
    fn exchange(&mut self, damage: Damage) {
        if self.left == 0 {
            return;
        }
        self.left -= 1;
        let motion = self.held.last().is_some_and(|frame| frame.slot(self.size, 1).id != 0);
        let held = WaitingFrames { frames: self.held.len(), motion, last: false };
        let (content, extra) = loop {
            match self.pacer.plan(self.now, held) {
                PacerPlan::Exchange { content, extra } => break (content, extra),
                PacerPlan::Wait(at) => {
                    assert!(at > self.now && at - self.now < WAIT_MAX_NS, "{at} at {}", self.now);
                    self.now = at;
                }
            }
        };
        let mut command = Frame::new();
        if content == ExchangeContent::Host {
            command = self.held.pop().expect("it is the host's");
        } else {
            self.pacer.own_frame(content, &mut command);
        }
        self.pacer.begins(&command, content, extra, self.now);
        let Self { board, newest, .. } = self;
        // What comes back was made before this.
        board.advance(self.now, &mut |report, _| newest.clone_from(report));
        let mut answer = newest.clone();
        board.host(&command, self.now, &mut |report, _| newest.clone_from(report));
        if !board.engine().talks() {
            // SW_RESET: a link ends there.
            assert!(board.boot(board::BOOT_NS));
            board.cycle(&mut |report, _| newest.clone_from(report));
            self.now = board.now();
        }
        self.pacer.ended(self.now);
        answer.bytes_mut()[3] = 0;
        if self.fills_crc {
            answer.fill_crc(self.size);
        }
        let right = answer.clone();
        self.harm(&mut answer, &command, damage);
        self.hear(answer, &right, extra, damage);
    }

    fn harm(&self, answer: &mut Frame, command: &Frame, damage: Damage) {
        let length = self.size.frame_len();
        let bytes = &mut answer.bytes_mut()[..length];
        match damage {
            Damage::None => {}
            Damage::Flipped { bit } => bytes[bit / 8 % length] ^= 1 << (bit % 8),
            Damage::Stuck(value) => bytes.fill(value),
            Damage::Slipped { bits, late } => slip(bytes, bits, late),
            Damage::Echo => bytes.copy_from_slice(command.wire(self.size)),
            Damage::Burst { at, pattern } => {
                let hit = bytes.iter_mut().skip(at % length);
                hit.zip(pattern.to_le_bytes()).for_each(|(byte, other)| *byte ^= other);
            }
        }
    }

    fn hear(&mut self, mut answer: Frame, right: &Frame, extra: bool, damage: Damage) {
        let fills = self.answer_check.fills_crc();
        let taken = self.answer_check.check(&answer);
        if answer.bytes() == right.bytes() {
            // A CRC that is right by chance is one in 256, and two of them are the wires' victory.
            assert!(taken.is_ok() || self.lucky > 1, "an answer of the board: {:02X?}", right.wire(self.size));
        } else if taken.is_ok() && answer.crc_byte() != 0 {
            self.lucky += 1;
        }
        if fills && self.fills_crc && matches!(damage, Damage::Flipped { .. }) {
            assert_eq!(taken, Err(InvalidAnswer), "a flipped bit");
        }
        let Ok(response) = taken else {
            return self.note_bad(right, damage);
        };
        self.bad = Bad::None;
        assert_eq!(response, MasterResponse::decode(&answer.slot(self.size, 0)));
        assert!(self.answer_check.fills_crc() >= fills);
        self.pacer.answered(&response, extra, self.held.len());
        let before = answer.clone();
        let differs = self.pacer.to_report(&mut answer, self.held.len());
        assert!(differs || before == answer);
        let shown = MasterResponse::decode(&answer.slot(self.size, 0));
        assert_eq!((shown.state, shown.error), (response.state, response.error));
        if response.state.state() == Some(MasterState::Op) {
            let most = usize::from(FIFO_ENTRIES).saturating_sub(self.held.len());
            assert!(usize::from(shown.fifo_free) <= most, "{} free with {} held", shown.fifo_free, self.held.len());
        }
    }

    /// An answer is none.
    fn note_bad(&mut self, right: &Frame, damage: Damage) {
        let now = match damage {
            Damage::Slipped { bits, late: true } if self.has_all(right, bits) => Bad::Late(bits),
            _ => Bad::Mixed,
        };
        self.bad = if self.bad == Bad::None || self.bad == now { now } else { Bad::Mixed };
    }

    /// Answers that are none are named.
    fn name(&self, damage: Damage) {
        if self.bad == Bad::None {
            return;
        }
        let fault = self.answer_check.explain();
        assert!(!fault.to_string().is_empty());
        match (damage, self.bad) {
            (Damage::Stuck(0), _) => assert_eq!(fault, WiringFault::Zeros),
            (Damage::Stuck(_), _) => assert_eq!(fault, WiringFault::Ones),
            (_, Bad::Late(bits)) => {
                assert!(
                    !matches!(fault, WiringFault::Ones | WiringFault::Zeros | WiringFault::Garbled),
                    "{bits} bits late: {fault:?}"
                );
            }
            _ => {}
        }
    }

    /// Whether an answer has a CRC and nothing but zeros slips out at its end, so that it can be told what it was.
    fn has_all(&self, right: &Frame, bits: usize) -> bool {
        let end = right.wire(self.size).last_chunk().map_or(0, |end| u64::from(u32::from_be_bytes(*end)));
        bits <= 32 && end & ((1 << bits) - 1) == 0 && right.crc_byte() != 0
    }
}

/// Moves the bits: each comes so many later, or earlier; none comes in their place.
fn slip(bytes: &mut [u8], bits: usize, late: bool) {
    let before = bytes.to_vec();
    let bit = |index: usize| before.get(index / 8).is_some_and(|byte| byte >> (7 - index % 8) & 1 == 1);
    for (number, byte) in bytes.iter_mut().enumerate() {
        *byte = (0..8).fold(0, |byte, low| {
            let to = number * 8 + low;
            let from = if late { to.checked_sub(bits) } else { Some(to + bits) };
            byte << 1 | u8::from(from.is_some_and(bit))
        });
    }
}
