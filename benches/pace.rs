//! `pace_1ms`, `pace_250us`: how late cycles begin, 99 of 100, under the runner of the real clock with four drives in OP,
//! against a bare loop of absolute sleeps. Both are counted from their own earliest cycle.

mod common;
#[path = "common/late.rs"]
mod late;

use std::sync::Arc;
use std::time::{Duration, Instant};

use common::Demand;
use ecmsk::engine::{Board, EngineConfig, Rate, RealTime, Threaded};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{
    CycleTime, DcShift, Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use late::{Begins, Watched, p99_lateness};
use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_gettime};

const SIZE: SlotSize = SlotSize::Bytes12;
const DRIVES: usize = 4;
const BLOCKS: usize = 7;
const BLOCK: Duration = Duration::from_millis(600);
const ALLOWANCE: Duration = Duration::from_micros(20);

fn main() {
    for (name, cycle_us) in [("pace_1ms", 1000), ("pace_250us", 250)] {
        let cycle = CycleTime::from_us(cycle_us).expect("a cycle time");
        let demand = Demand { name, target: Some(1.2), allowance: Some(ALLOWANCE), against: None };
        common::pair_of_blocks(demand, BLOCKS, || runner(cycle), || bare_loop(cycle));
    }
}

fn runner(cycle: CycleTime) -> f64 {
    let begins = Begins::default();
    let board = board_in_op(cycle, &begins);
    *begins.lock().expect("nobody panics") = Vec::with_capacity(100_000);
    let runner = Threaded::start(board, 125_000, 32, RealTime::default(), Rate::default()).expect("a thread");
    std::thread::sleep(BLOCK);
    runner.close();
    let begins = begins.lock().expect("nobody panics");
    p99_lateness(begins.iter().copied())
}

fn bare_loop(cycle: CycleTime) -> f64 {
    let zero = clock_gettime(ClockId::Monotonic);
    let cycles = BLOCK.as_nanos() as u64 / cycle.ns();
    let begins: Vec<_> = (1..=cycles)
        .map(|n| {
            let due = n * cycle.ns();
            let nanos = zero.tv_nsec + (due % 1_000_000_000) as i64;
            let at = Timespec {
                tv_sec: zero.tv_sec + (due / 1_000_000_000) as i64 + nanos / 1_000_000_000,
                tv_nsec: nanos % 1_000_000_000,
            };
            clock_nanosleep_absolute(ClockId::Monotonic, &at).expect("the clock is there");
            (Instant::now(), due)
        })
        .collect();
    p99_lateness(begins.into_iter())
}

fn board_in_op(cycle: CycleTime, begins: &Begins) -> Board {
    let drives = (0..DRIVES).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect();
    let bus = Watched { bus: SimBus::new(drives), begins: Arc::clone(begins) };
    let mut board = Board::new(EngineConfig::default(), Box::new(bus));
    assert!(board.boot(60_000_000_000));
    let mut kinds = [SlaveKind::None; 8];
    kinds[..DRIVES].fill(SlaveKind::Drive);
    for command in [
        MasterCommand::SetAxis { group: 0, kinds },
        MasterCommand::SetDc { cycle, shift: DcShift::Auto },
        MasterCommand::SetState(MasterState::Op),
    ] {
        let mut frame = Frame::new();
        frame.put_master(SIZE, &command);
        let at = board.now();
        board.host(&frame, at, &mut |_, _| {});
    }
    for _ in 0..100_000 {
        let mut op = false;
        board.cycle(&mut |report, _| {
            let state = MasterResponse::decode(&report.slot(SIZE, 0)).state;
            op = state == StateByte::reached(MasterState::Op);
        });
        if op {
            return board;
        }
    }
    panic!("the bench's board does not come up");
}
