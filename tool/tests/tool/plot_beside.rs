//! `ecmsk plot --beside`: another run of the same program in the picture of the first.

use ecmsk::sk::SlotSize;

use crate::common::motion::{FAULTED, FakeBoard};
use crate::common::plots::{Recorded, near};
use crate::common::svg::STATES;

const FAULT: &str = STATES[0];
/// The colour of the second recording.
const BLACK: &str = "#202020";

/// A run in which one axis moves 10 counts in each of `cycles` cycles; in the cycles `faulted` its drive has an alarm. Returns
/// its recording, and the beginning and the end of the alarm in seconds.
fn run(cycles: i32, faulted: std::ops::Range<i32>) -> (Recorded, (f64, f64)) {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    let fine = run.drives[0];
    let mut times = (0.0, 0.0);
    for cycle in 0..cycles {
        run.send(&[10 * cycle]);
        let has_alarm = faulted.contains(&cycle);
        run.drives[0] = fine;
        if has_alarm {
            (run.drives[0].statusword, run.drives[0].error_code) = (FAULTED, 0x7500);
        }
        run.cycle();
        if cycle == faulted.start {
            times.0 = run.seconds();
        }
        if cycle == faulted.end {
            times.1 = run.seconds();
        }
    }
    (Recorded::of_link(&run, "xf-sim:?slaves=drive"), times)
}

/// The longer run is shown to its end, whichever is the first one, and an alarm of the other run is marked like one of
/// the first, with the name of the run beside it.
#[test]
fn both_runs_are_seen_to_their_ends_with_their_alarms() {
    let (short, _) = run(300, 0..0);
    let (long, alarm) = run(900, 500..550);
    let plot = short.plot(&["--beside", long.file.to_str().expect("UTF-8")]);
    let panel = plot.panel("Axis 1");
    let last = panel.samples(BLACK, false).last().copied().expect("the other run");
    near(last.0, 0.9, 0.9);
    let found = panel.spans(FAULT);
    assert_eq!(found.len(), 1, "{found:?}");
    near(found[0].0, alarm.0, 0.9);
    near(found[0].1, alarm.1, 0.9);
    assert_eq!(
        panel.notes().iter().map(|(_, text)| *text).collect::<Vec<_>>(),
        ["alarm 0x7500: communication, xf-sim:"]
    );
    assert_eq!(plot.texts().iter().filter(|text| **text == "fault").count(), 1, "in the legend");

    let plot = long.plot(&["--beside", short.file.to_str().expect("UTF-8")]);
    let panel = plot.panel("Axis 1");
    near(panel.samples(BLACK, false).last().expect("the other run").0, 0.3, 0.9);
    assert_eq!(panel.notes().iter().map(|(_, text)| *text).collect::<Vec<_>>(), ["alarm 0x7500: communication"]);
    // A range of times (`--from`) applies to both recordings.
    let plot = long.plot(&["--beside", short.file.to_str().expect("UTF-8"), "--from", "0.4"]);
    assert!(plot.panel("Axis 1").samples(BLACK, false).is_empty());
}
