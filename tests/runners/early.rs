//! The counters of the runner of the real clock, and that it is never early. No test here asserts durations.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ecmsk::engine::{Board, EngineConfig, Rate, RealTime, Threaded};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::Frame;

use crate::client::board;
use crate::slow::Hooked;

/// Longer than any call takes here.
const PATIENCE: Option<Duration> = Some(Duration::from_secs(60));

fn start(board: Board, queue: usize) -> Threaded {
    Threaded::start(board, 0, queue, RealTime::default(), Rate::default()).unwrap()
}

/// SK-9.8 A report comes at its time on the machine's clock, and not before, even if several cycles pass between two
/// readings of the clock. No cycle is ahead of the elapsed time, and there are no more cycles than fit that time.
#[test]
fn the_runner_is_never_early() {
    let (board, _) = board(1);
    let zero = board.now();
    assert!(zero > 0, "a board that ran before");
    let began = Instant::now();
    let runner = start(board, 32);
    let mut report = Frame::new();
    for _ in 0..80 {
        let at = runner.read(&mut report, PATIENCE).unwrap().at - zero;
        let passed = began.elapsed();
        assert!(u128::from(at) <= passed.as_nanos(), "a report of {at} ns after {passed:?}");
    }
    // Cycles that are caught up consecutively are counted when the last of them has ended.
    let (late, passed) = loop {
        let late = runner.lateness();
        let passed = began.elapsed();
        if late.cycles >= 80 {
            break (late, passed);
        }
        assert!(passed < PATIENCE.unwrap(), "{late:?} after {passed:?}");
    };
    assert!(u128::from(late.worst_ns) <= passed.as_nanos(), "{late:?} after {passed:?}");
    assert!(u128::from(late.cycles) <= passed.as_millis() + 1, "{late:?} after {passed:?}");
}

/// LIB-55 It reports the board's counters, and the unread reports.
#[test]
fn the_runner_reports_the_counters_of_the_board() {
    let (board, _) = board(1);
    let runner = start(board, 2);
    for _ in 0..3 {
        runner.write(&Frame::new(), PATIENCE).unwrap();
    }
    let began = Instant::now();
    loop {
        let (counters, dropped) = runner.counters();
        if counters.frames == 3 && dropped >= 3 {
            break;
        }
        assert!(began.elapsed() < PATIENCE.unwrap(), "{counters:?}, {dropped} dropped");
    }
}

/// Dropping it ends its thread: nothing of the board is left.
#[test]
fn dropping_the_runner_ends_its_thread() {
    let held = Arc::new(());
    let holds = Arc::clone(&held);
    let bus = Hooked(SimBus::new(Vec::new()), move || _ = Arc::strong_count(&holds));
    drop(start(Board::new(EngineConfig::default(), Box::new(bus)), 4));
    assert_eq!(Arc::strong_count(&held), 1);
}
