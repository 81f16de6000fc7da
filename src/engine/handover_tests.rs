//! Tests of the hand-over alone, on threads of the operating system. `tests/schedules` tries all interleavings with a
//! scheduler of its own.

use std::thread;
use std::time::{Duration, Instant};

use super::handover::Handover;
use super::stepped::Stop;
use crate::sk::Frame;

/// A time limit so long that only a hanging test reaches it.
const PATIENCE: Duration = Duration::from_secs(20);

/// LIB-38 A writer waits while the inbox is full, until the runner has taken a frame, and no longer than its timeout.
/// Frames come out in order, each of them not before its time of arrival.
#[test]
fn a_full_inbox_makes_a_writer_wait() {
    let handover = Handover::new(2, 4);
    let (frame, mut out) = (Frame::new(), Frame::new());
    let send = |at, limit| {
        let now = Instant::now();
        handover.send(&frame, at, now, Some(now + limit))
    };
    assert_eq!([send(10, PATIENCE), send(20, PATIENCE)], [Ok(()); 2]);
    assert_eq!(send(30, Duration::from_millis(20)), Err(Stop::Timeout));
    thread::scope(|scope| {
        let writer = scope.spawn(|| send(30, PATIENCE));
        // Usually the writer waits for room after this time. If its thread starts even later, it finds room at once, and
        // the assertions below hold as well.
        thread::sleep(Duration::from_millis(50));
        assert_eq!(handover.next_frame(&mut out, |at| at <= 9), None);
        assert_eq!(handover.next_frame(&mut out, |at| at <= 10), Some(10));
        assert_eq!(writer.join().unwrap(), Ok(()), "it is told that there is room");
    });
    let times = [19, 25, 29, u64::MAX, u64::MAX].map(|by| handover.next_frame(&mut out, |at| at <= by));
    assert_eq!(times, [None, Some(20), None, Some(30), None]);
}

/// LIB-55 The newest unread reports are kept, and the dropped ones are counted.
#[test]
fn reports_are_dropped_and_counted() {
    let handover = Handover::new(1, 4);
    let (frame, mut out) = (Frame::new(), Frame::new());
    for (n, dropped) in [(0, 0), (1, 0), (2, 0), (3, 0), (4, 1), (5, 2)] {
        handover.publish(&frame, n);
        assert_eq!(handover.dropped(), dropped);
    }
    let report = handover.receive(&mut out, Some(Instant::now() + PATIENCE)).unwrap();
    assert_eq!((report.at, report.sequence, report.dropped), (2, 2, 2));
}
