//! `ecmsk plot`: where the FIFO was empty while an axis was moving.

use crate::common::motion::FakeBoard;
use crate::common::plots::{Recorded, spans_are};
use crate::common::svg::{GAP, Panel};
use ecmsk::sk::SlotSize;

/// Asserts that the panel marks these gaps, each with its beginning and end in seconds, with a tolerance of 0.8 ms: less than a
/// cycle.
#[track_caller]
fn are(panel: &Panel<'_>, expected: &[(f64, f64)]) {
    spans_are(&panel.spans(GAP), expected, 0.0008);
}

/// Axis 1 goes 10 counts a cycle, axis 2 stands. The host is `ahead` commands ahead, and sends nothing in the cycles
/// `away`. Returns the run and the time in which the board had no entry to execute.
fn late(ahead: i32, away: std::ops::Range<i32>) -> (FakeBoard, (f64, f64)) {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 2);
    let (mut sent, mut idle) = (0, Vec::new());
    for cycle in 0..400 {
        if !away.contains(&cycle) {
            while sent < cycle + ahead - if cycle < away.end { 0 } else { away.end - away.start } {
                run.send(&[10 * sent, 500]);
                sent += 1;
            }
        }
        let nothing = run.waiting() == 0;
        run.cycle();
        if nothing || idle.len() == 1 {
            idle.push(run.seconds());
        }
    }
    let (first, last) = (idle[0], idle[idle.len() - 1]);
    // The gap ends in the cycle after the last one without an entry to execute.
    (run, (first, last + 0.001))
}

/// TOOL-147 A gap is marked in the panel of the axis that was moving and in that of the FIFO, with its length, from the first
/// cycle that found nothing to execute to the next target; the axis that stood has none.
#[test]
fn an_empty_fifo_during_motion_is_marked_with_its_length() {
    for ahead in [1, 3, 20] {
        let (run, gap) = late(ahead, 100..140);
        let plot = Recorded::new(&run).plot(&[]);
        are(&plot.panel("Axis 1"), &[gap]);
        are(&plot.panel("Axis 2"), &[]);
        are(&plot.panel("FIFO"), &[gap]);
        let panel = plot.panel("Axis 1");
        let notes = panel.notes();
        let milliseconds = ((gap.1 - gap.0) * 1000.0).round();
        assert_eq!(notes.iter().map(|(_, text)| *text).collect::<Vec<_>>(), [format!("gap {milliseconds} ms")]);
        assert_eq!(plot.texts().iter().filter(|text| text.starts_with("gap: FIFO empty")).count(), 2, "in two legends");
    }
}

/// TOOL-147 No gap is marked at the end of a motion, in a pause between two motions, or when a host is late but commands wait
/// in the FIFO.
#[test]
fn ends_and_pauses_of_motion_are_no_gaps() {
    let (run, _) = {
        let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
        for start in [0, 2000] {
            // The motion begins and ends slowly, as a planned motion does.
            for i in 0..=100_i32 {
                run.send(&[start + i * i * (300 - 2 * i) / 500]);
                run.cycle();
            }
            (0..150).for_each(|_| run.cycle());
        }
        (run, ())
    };
    let plot = Recorded::new(&run).plot(&[]);
    are(&plot.panel("Axis 1"), &[]);
    assert!(!plot.texts().iter().any(|text| text.starts_with("gap")), "{:?}", plot.texts());

    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    for i in 0..30 {
        run.send(&[10 * i]);
    }
    (0..25).for_each(|_| run.cycle());
    for i in 30..60 {
        run.send(&[10 * i]);
        run.cycle();
    }
    are(&Recorded::new(&run).plot(&[]).panel("Axis 1"), &[]);
}
