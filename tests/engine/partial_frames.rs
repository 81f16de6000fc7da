//! Command frames that arrive in pieces: CONFIG3.

use ecmsk::engine::{EngineConfig, EventKind, INCOMPLETE_CYCLES, PartialFrames};
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{
    CycleTime, DcShift, FIFO_ENTRIES, Frame, MasterCommand, MasterState, SlaveCommand, SlotSize, StateByte,
};
use proptest::prelude::*;

use crate::host::Host;
use crate::probe::{any_slaves, drives};

const MS: Ns = 1_000_000;

fn board(slot: SlotSize, partial_frames: PartialFrames) -> Host {
    let config = EngineConfig { slot, partial_frames, ..EngineConfig::default() };
    Host::new(config, SimBus::new(drives(1)))
}

/// Lets bytes arrive after that time.
fn arrive(host: &mut Host, bytes: &[u8], after: Ns) {
    let at = host.board.now() + after;
    let Host { board, report, reports, .. } = host;
    board.bytes(bytes, at, &mut |frame, _| {
        report.clone_from(frame);
        *reports += 1;
    });
}

fn local_write(size: SlotSize, bits: u8) -> Vec<u8> {
    let mut frame = Frame::new();
    frame.put_master(size, &MasterCommand::LocalWrite(bits));
    frame.fill_crc(size);
    frame.wire(size).to_vec()
}

/// SK-5.15 A frame that arrives completely within 100 cycles counts, however it is divided; SK-10.13 504 bytes are one
/// frame in 12-byte mode, 512 in 16-byte mode.
#[test]
fn a_frame_in_pieces() {
    for size in SlotSize::ALL {
        let mut host = board(size, PartialFrames::Dropped);
        let frame = local_write(size, 0x15);
        assert_eq!(frame.len(), if size == SlotSize::Bytes12 { 504 } else { 512 });
        for (n, piece) in frame.chunks(7).enumerate() {
            assert_eq!((host.counters().frames, host.board.engine().local_outputs()), (0, 0), "{size:?}: piece {n}");
            arrive(&mut host, piece, MS);
        }
        assert_eq!((host.counters().frames, host.board.engine().local_outputs()), (1, 0x15), "{size:?}");
        // Two and a half in one go, then the rest.
        let frames: Vec<u8> = [1, 2, 3].into_iter().flat_map(|bits| local_write(size, bits)).collect();
        let (first, rest) = frames.split_at(frame.len() * 5 / 2);
        arrive(&mut host, first, 0);
        assert_eq!((host.counters().frames, host.board.engine().local_outputs()), (3, 2), "{size:?}");
        arrive(&mut host, rest, 0);
        assert_eq!((host.counters().frames, host.board.engine().local_outputs()), (4, 3), "{size:?}");
        assert_eq!(host.counters().incomplete, 0);
    }
}

/// SK-5.15 After 100 cycles an incomplete frame is dropped. SK-4.46 It is counted as incomplete and logged.
#[test]
fn a_frame_that_stays_incomplete() {
    assert_eq!(INCOMPLETE_CYCLES, 100);
    let limit = 100 * MS;
    for (after, in_time) in [(limit - 1, true), (limit, true), (limit + 1, false), (3 * limit, false)] {
        let mut host = board(SlotSize::Bytes12, PartialFrames::Dropped);
        host.cycles(3);
        let (frame, mark) = (local_write(SlotSize::Bytes12, 0x2A), host.mark());
        arrive(&mut host, &frame[..300], 123);
        arrive(&mut host, &frame[300..], after);
        let counters = host.counters();
        assert_eq!((counters.frames, counters.incomplete), if in_time { (1, 0) } else { (0, 1) }, "{after}");
        assert_eq!(host.board.engine().local_outputs(), if in_time { 0x2A } else { 0 });
        let kinds: Vec<EventKind> = host.board.engine().events_since(mark).map(|event| event.kind).collect();
        assert_eq!(kinds, if in_time { vec![] } else { vec![EventKind::Incomplete { bytes: 300 }] });
    }
}

/// SK-5.15 The time runs from the first byte, and ends without another byte: the next frame is whole.
#[test]
fn the_time_ends_by_itself() {
    let mut host = board(SlotSize::Bytes12, PartialFrames::Dropped);
    let frame = local_write(SlotSize::Bytes12, 7);
    for _ in 0..4 {
        arrive(&mut host, &frame[..100], 40 * MS);
    }
    assert_eq!(host.counters().incomplete, 1, "at 120 ms after the first byte the fourth piece begins another one");
    host.cycles(99);
    assert_eq!(host.counters().incomplete, 1);
    host.cycles(3);
    assert_eq!(host.counters().incomplete, 2);
    arrive(&mut host, &frame, 0);
    assert_eq!((host.counters().frames, host.board.engine().local_outputs()), (1, 7));
    host.cycles(500);
    assert_eq!(host.counters().incomplete, 2, "nothing is under way");
}

/// SK-5.15 In OP the 100 cycles are EtherCAT cycles. SK-5.2 A dropped frame takes no entry.
#[test]
fn cycles_are_those_of_op() {
    for us in [250u32, 4000] {
        let mut host = board(SlotSize::Bytes12, PartialFrames::Dropped);
        host.master(MasterCommand::SetDc { cycle: CycleTime::from_us(us).unwrap(), shift: DcShift::Auto });
        host.op(1).cycles(5);
        let (limit, executed) = (Ns::from(us) * 100_000, host.counters().executed);
        let mut frame = Frame::new();
        frame.put_slave(SlotSize::Bytes12, 1, &SlaveCommand::ServoOn.into());
        let bytes = frame.wire(SlotSize::Bytes12);
        arrive(&mut host, &bytes[..503], 0);
        arrive(&mut host, &bytes[503..], limit);
        assert_eq!((host.counters().incomplete, host.board.engine().fifo_free()), (0, FIFO_ENTRIES - 1), "{us} us");
        host.cycles(5);
        assert_eq!(host.counters().executed, executed + 1);
        arrive(&mut host, &bytes[..503], 0);
        host.cycles(101);
        assert_eq!((host.counters().incomplete, host.board.engine().fifo_free()), (1, FIFO_ENTRIES), "{us} us");
        assert_eq!((host.counters().executed, host.counters().full), (executed + 1, 0), "{us} us");
    }
}

/// SK-5.16 CONFIG3 low: the board waits for the rest without limit.
#[test]
fn a_frame_that_is_waited_for() {
    let mut host = board(SlotSize::Bytes16, PartialFrames::Awaited);
    let frame = local_write(SlotSize::Bytes16, 0x3F);
    arrive(&mut host, &frame[..511], 0);
    host.cycles(20_000);
    assert_eq!((host.counters().frames, host.counters().incomplete), (0, 0));
    arrive(&mut host, &frame[511..], 60_000 * MS);
    assert_eq!((host.counters().frames, host.counters().incomplete), (1, 0));
    assert_eq!(host.board.engine().local_outputs(), 0x3F);
}

/// SK-1.24 SK-1.25 A dropped frame is no CRC error; a frame that begins with the rest of one is. SK-5.15
#[test]
fn partial_frames_and_the_crc() {
    let size = SlotSize::Bytes12;
    let mut host = board(size, PartialFrames::Dropped);
    host.master(MasterCommand::SetEx { check_commands: true, fill_responses: true }).soft_reset();
    let frame = local_write(size, 0x11);
    arrive(&mut host, &frame[..200], 0);
    host.cycles(150);
    assert_eq!((host.counters().crc, host.counters().incomplete), (0, 1));
    // The rest comes late, with a whole frame behind it.
    arrive(&mut host, &frame[200..], 0);
    arrive(&mut host, &frame, 0);
    assert_eq!((host.counters().crc, host.counters().incomplete), (1, 1));
    host.cycles(150);
    assert_eq!((host.counters().crc, host.counters().incomplete), (1, 2), "a pause ends it");
    arrive(&mut host, &frame, 0);
    assert_eq!((host.counters().crc, host.board.engine().local_outputs()), (1, 0x11));
    host.cycles(2);
    assert_eq!(host.answer().error, 1);
}

/// SK-4.43 Each frame of a piece is executed, including SW_RESET: frames behind it find a booting board.
#[test]
fn sw_reset_in_a_piece() {
    let size = SlotSize::Bytes12;
    let mut host = board(size, PartialFrames::Dropped);
    let mut reset = Frame::new();
    reset.put_master(size, &MasterCommand::SoftReset);
    let mut bytes = reset.wire(size).to_vec();
    bytes.extend(local_write(size, 1));
    arrive(&mut host, &bytes, 0);
    assert_eq!((host.board.engine().boots(), host.counters().while_booting), (2, 1));
}

/// SK-5.15 Bytes allocate nothing.
#[test]
fn bytes_allocate_nothing() {
    let mut host = board(SlotSize::Bytes12, PartialFrames::Dropped);
    let frame = local_write(SlotSize::Bytes12, 1);
    let counted = allocation_counter::measure(|| {
        for piece in frame.chunks(50) {
            arrive(&mut host, piece, MS);
        }
        arrive(&mut host, &frame[..9], 0);
        host.cycles(200);
    });
    assert_eq!((counted.count_total, host.counters().frames, host.counters().incomplete), (0, 1, 1));
}

proptest! {
    /// SK-5.15 However a stream of frames is cut, as long as it does not pause, every frame counts once and in order.
    #[test]
    fn any_cut_is_the_same_stream(
        cuts in proptest::collection::vec((1usize..1300, 0u64..900_000), 1..40),
        twelve in any::<bool>(),
    ) {
        let size = if twelve { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
        let config = EngineConfig { slot: size, ..EngineConfig::default() };
        let mut host = Host::new(config, SimBus::new(any_slaves(1)));
        let total: usize = cuts.iter().map(|(bytes, _)| bytes).sum();
        let stream: Vec<u8> = (0u8..).cycle().flat_map(|n| local_write(size, n & 0x3F)).take(total).collect();
        let mut rest = &stream[..];
        for (bytes, after) in &cuts {
            let (piece, tail) = rest.split_at(*bytes);
            rest = tail;
            arrive(&mut host, piece, *after);
            let whole = (stream.len() - rest.len()) / size.frame_len();
            prop_assert_eq!(host.counters().frames, whole as u64);
            let newest = whole.checked_sub(1).map_or(0, |n| (n % 256) as u8 & 0x3F);
            prop_assert_eq!(host.board.engine().local_outputs(), newest);
        }
        prop_assert_eq!(host.counters().incomplete, 0);
        prop_assert_eq!(host.board.engine().state(), StateByte::reached(MasterState::PreOp));
    }
}

/// SK-4.77 SW_RESET drops a partial frame, too, and bytes that come while the board boots begin no frame: the first
/// byte after the boot is the first of a frame, also if incomplete frames are waited for (SK-5.16).
#[test]
fn sw_reset_forgets_a_frame_under_way() {
    for size in SlotSize::ALL {
        let mut reset = Frame::new();
        reset.put_master(size, &MasterCommand::SoftReset);
        reset.fill_crc(size);
        // Bytes that come with it, and bytes that come while the board boots.
        for (with, later) in [(100, 0), (0, 100), (100, 100), (size.frame_len() - 1, 700)] {
            let mut host = board(size, PartialFrames::Awaited);
            let mut bytes = reset.wire(size).to_vec();
            bytes.resize(bytes.len() + with, 0xEE);
            arrive(&mut host, &bytes, 0);
            arrive(&mut host, &vec![0xEE; later], 5 * MS);
            assert!(host.board.boot(crate::host::BOOT_LIMIT));
            let cut_off = [with, later].into_iter().filter(|bytes| *bytes > 0).count() as u64;
            assert_eq!(host.counters().incomplete, cut_off, "{size:?}: {with} and {later} bytes");
            for bits in [0x11, 0x22, 0x33] {
                arrive(&mut host, &local_write(size, bits), MS);
                assert_eq!(host.board.engine().local_outputs(), bits, "{size:?}: {with} and {later} bytes");
            }
        }
    }
}
