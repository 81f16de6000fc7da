//! The files of the hand-over, and the tests.

// Functions called only by the runner are not called here.
#[allow(dead_code)]
#[path = "../../../../src/engine/handover.rs"]
mod handover;
#[path = "../../../../src/engine/reports.rs"]
mod reports;

mod stepped {
    pub use ecmsk::engine::Stop;
}

mod sync {
    pub use shuttle::sync::{Condvar, Mutex, MutexGuard};
    use std::time::Duration;

    pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
        mutex.lock().unwrap()
    }

    pub fn wait<'a, T>(condvar: &Condvar, guard: MutexGuard<'a, T>) -> MutexGuard<'a, T> {
        condvar.wait(guard).unwrap()
    }

    pub fn wait_for<'a, T>(condvar: &Condvar, guard: MutexGuard<'a, T>, limit: Duration) -> MutexGuard<'a, T> {
        condvar.wait_timeout(guard, limit).unwrap().0
    }
}

use ecmsk::engine::Stop;
use ecmsk::sk::Frame;
use handover::Handover;
use shuttle::sync::Arc;
use shuttle::thread;
use std::time::Instant;

const SCHEDULES: usize = 2000;

fn numbered(writer: u8, n: u8) -> Frame {
    Frame::from_prefix(&[writer, n])
}

/// Two writers through an inbox of two: every accepted frame comes out once, each writer's in order, and a writer that
/// waits for room is woken.
#[test]
fn every_accepted_frame_arrives_once_and_in_order() {
    shuttle::check_random(
        || {
            let handover = Arc::new(Handover::new(2, 4));
            let writers: Vec<_> = (0..2u8)
                .map(|writer| {
                    let handover = Arc::clone(&handover);
                    thread::spawn(move || {
                        for n in 0..4 {
                            handover.send(&numbered(writer, n), 0, Instant::now(), None).unwrap();
                        }
                    })
                })
                .collect();
            let mut seen = [0u8; 2];
            let mut frame = Frame::new();
            while seen != [4, 4] {
                match handover.next_frame(&mut frame, |_| true) {
                    Some(_) => {
                        let [writer, n] = [frame.bytes()[0], frame.bytes()[1]];
                        assert_eq!(n, seen[usize::from(writer)], "writer {writer}");
                        seen[usize::from(writer)] += 1;
                    }
                    None => thread::yield_now(),
                }
            }
            writers.into_iter().for_each(|writer| writer.join().unwrap());
        },
        SCHEDULES,
    );
}

/// Closing while a writer waits for room and a reader for a report: both end, and frames accepted before are still
/// there for the runner.
#[test]
fn closing_ends_every_wait_and_loses_nothing_accepted() {
    shuttle::check_random(
        || {
            let handover = Arc::new(Handover::new(1, 1));
            let writer = {
                let handover = Arc::clone(&handover);
                thread::spawn(move || {
                    (0..3u8).take_while(|n| handover.send(&numbered(0, *n), 0, Instant::now(), None).is_ok()).count()
                })
            };
            let reader = {
                let handover = Arc::clone(&handover);
                thread::spawn(move || {
                    let mut frame = Frame::new();
                    while handover.receive(&mut frame, None).is_ok() {}
                    handover.receive(&mut frame, None)
                })
            };
            let runner = {
                let handover = Arc::clone(&handover);
                thread::spawn(move || {
                    let mut frame = Frame::new();
                    let mut taken = 0;
                    for _ in 0..2 {
                        taken += usize::from(handover.next_frame(&mut frame, |_| true).is_some());
                        handover.publish(&frame, 0);
                    }
                    taken
                })
            };
            let taken = runner.join().unwrap();
            handover.end(Stop::Closed);
            let accepted = writer.join().unwrap();
            let mut frame = Frame::new();
            let left = std::iter::from_fn(|| handover.next_frame(&mut frame, |_| true)).count();
            assert_eq!(accepted, taken + left);
            assert_eq!(reader.join().unwrap(), Err(Stop::Closed));
        },
        SCHEDULES,
    );
}

/// A waiting reader gets a report, however publish and wait interleave.
#[test]
fn a_report_wakes_the_reader() {
    shuttle::check_random(
        || {
            let handover = Arc::new(Handover::new(1, 2));
            let reader = {
                let handover = Arc::clone(&handover);
                thread::spawn(move || {
                    let mut frame = Frame::new();
                    let report = handover.receive(&mut frame, None).unwrap();
                    (report.sequence, report.at, frame.bytes()[1])
                })
            };
            handover.publish(&numbered(0, 7), 42);
            assert_eq!(reader.join().unwrap(), (0, 42, 7));
            assert_eq!(handover.dropped(), 0);
        },
        SCHEDULES,
    );
}

/// Cancelling ends the waits of one direction and does not affect later calls; the loss of the board ends the waits of
/// both.
#[test]
fn cancel_and_loss_end_the_waits() {
    shuttle::check_random(
        || {
            let handover = Arc::new(Handover::new(1, 1));
            handover.send(&numbered(0, 0), 0, Instant::now(), None).unwrap();
            let calls: Vec<_> = [true, false]
                .into_iter()
                .map(|write| {
                    let handover = Arc::clone(&handover);
                    thread::spawn(move || match write {
                        true => handover.send(&numbered(0, 1), 0, Instant::now(), None),
                        false => handover.receive(&mut Frame::new(), None).map(|_| ()),
                    })
                })
                .collect();
            handover.cancel_writes();
            handover.cancel_reads();
            handover.end(Stop::Rebooted);
            handover.end(Stop::Closed);
            for call in calls {
                let ended = call.join().unwrap();
                assert!(matches!(ended, Err(Stop::Cancelled | Stop::Rebooted)), "{ended:?}");
            }
            assert_eq!(handover.send(&numbered(0, 2), 0, Instant::now(), None), Err(Stop::Rebooted));
            assert_eq!(handover.check(), Err(Stop::Rebooted));
        },
        SCHEDULES,
    );
}
