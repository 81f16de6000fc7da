//! Any sequence of frames, pauses and cable faults on a modelled board: it never panics, no frame is lost uncounted, and
//! the free space it shows is the truth.

#![no_main]

use ecmsk::engine::{Board, EngineConfig, Firmware};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{CrcPolicy, FIFO_ENTRIES, Frame, MasterResponse, RawSlot, SlotSize};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use libfuzzer_sys::fuzz_target;

/// More cycles than any change of state takes in a board's usual times.
const CYCLES_MAX: u8 = 255;

fuzz_target!(|script: &[u8]| {
    let Some((kind, script)) = script.split_first() else { return };
    let size = if kind & 1 == 0 { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
    let firmware = if kind & 2 == 0 { Firmware::V17 } else { Firmware::V15 };
    let drives = 1 + usize::from(kind >> 2 & 3);
    let slaves = (0..drives).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect();
    let bus = SimBus::new(slaves);
    let mut board = Board::new(EngineConfig { slot: size, firmware, ..EngineConfig::default() }, Box::new(bus));
    assert!(board.boot(60_000_000_000));

    let mut frame = Frame::new();
    let mut check = |report: &Frame, _| {
        assert_eq!(report.check_crc(size, CrcPolicy::AbsentAllowed), Ok(()));
        let answer = MasterResponse::decode(&report.slot(size, 0));
        assert!(answer.fifo_free <= FIFO_ENTRIES);
    };
    // A step: what to do, then how often or where, then what.
    let mut steps = script.chunks_exact(12);
    for step in steps.by_ref() {
        match step[0] % 4 {
            0 => (0..step[1].min(CYCLES_MAX)).for_each(|_| board.cycle(&mut check)),
            1 => frame = Frame::new(),
            2 => frame.put(size, usize::from(step[1]) % size.slots(), &slot(&step[2..])),
            _ => {
                frame.put(size, 0, &slot(&step[2..]));
                for _ in 0..=step[1] {
                    let at = board.now() + 125_000;
                    board.host(&frame, at, &mut check);
                    if !board.engine().talks() {
                        // SW_RESET: the link would be dead until it is opened again.
                        assert!(board.boot(60_000_000_000));
                    }
                }
            }
        }
    }
    let counters = board.engine().counters();
    assert!(counters.executed + counters.full + counters.crc + counters.cleared <= counters.frames);
});

fn slot(bytes: &[u8]) -> RawSlot {
    RawSlot {
        id: bytes[0],
        index: bytes[1],
        parm: u16::from_le_bytes([bytes[2], bytes[3]]),
        data1: u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]),
        data2: u32::from(bytes[8]),
        data3: u32::from(bytes[9]),
    }
}
