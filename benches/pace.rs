//! `pace_1ms`, `pace_250us`: how late cycles begin, 99 of 100, under the runner of the real clock with four drives in OP,
//! against a bare loop of absolute sleeps. Both are counted from their own earliest cycle.

mod common;

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use common::Demand;
use ecmsk::engine::{Board, EngineConfig, Rate, RealTime, Threaded};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{CycleDone, Fieldbus, Inputs, Ns};
use ecmsk::sk::{
    CycleTime, DcShift, Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_gettime};
use support::hand_on;

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

/// Instants at which cycles began, each with the time at which it was due by its own clock.
type Begins = Arc<Mutex<Vec<(Instant, Ns)>>>;

/// A bus that notes when it is polled.
struct Watched {
    bus: SimBus,
    begins: Begins,
}

impl Fieldbus for Watched {
    hand_on!(bus: pacing, start, start_sdo, poll_job, poll_sdo, cancel_job, cancel_sdo, room, clear_ahead, poll_clear, push);

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        let mut begins = self.begins.lock().expect("nobody panics");
        if begins.len() < begins.capacity() {
            begins.push((Instant::now(), now));
        }
        self.bus.poll(now, inputs)
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

/// The lateness that 99 of 100 cycles do not exceed, nanoseconds, counted from the one that was least late.
fn p99_lateness(begins: impl Iterator<Item = (Instant, Ns)>) -> f64 {
    let mut begins = begins.peekable();
    let start = begins.peek().expect("cycles ran").0;
    let mut late: Vec<i64> = begins.map(|(at, due)| at.duration_since(start).as_nanos() as i64 - due as i64).collect();
    late.sort_unstable();
    (late[late.len() * 99 / 100] - late[0]) as f64
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
