//! `ecmsk plot --difference`: the target executed in a cycle minus the position that its report has.

use crate::common::motion::FakeBoard;
use crate::common::plots::{Recorded, near, two_axes};
use crate::common::svg::COLOURS;
use ecmsk::sk::{MasterState, SlotSize};

/// The following difference compares a position with the target executed at that time, not with the one sent at that
/// time.
#[test]
fn the_difference_is_to_the_target_that_was_executed_then() {
    let (run, cycles) = two_axes();
    let plot = Recorded::new(&run).plot(&["--difference"]);
    let panel = plot.panel("Following difference");
    for (axis, colour) in [(0, COLOURS[0]), (1, COLOURS[1])] {
        for cycle in cycles.iter().skip(1).step_by(50) {
            near(panel.at(colour, false, cycle.seconds), f64::from(cycle.target[axis] - cycle.position[axis]), 180.0);
        }
    }
    assert!(!Recorded::new(&run).plot(&[]).panel_names().contains(&"Following difference (counts)"));
}

/// A command and a report that cross each other give no wrong difference.
#[test]
fn a_command_and_a_report_that_cross_give_no_wrong_difference() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    for i in 0..400 {
        match i {
            0..8 => board.send(&[100 * i]),
            200 | 300 => board.send_across_a_cycle(&[100 * i]),
            _ => {
                board.send(&[100 * i]);
                board.cycle();
            }
        }
    }
    let plot = Recorded::new(&board).plot(&["--difference"]);
    let samples = plot.panel("Following difference").samples(COLOURS[0], false);
    let settled = samples.iter().filter(|(seconds, _)| *seconds > 0.1);
    for (_, difference) in settled {
        near(*difference, 900.0, 900.0);
    }
    assert!(samples.len() > 300, "{} samples", samples.len());
}

/// After commands were lost the difference is not shown until it is known again, and never a wrong one.
#[test]
fn after_a_loss_no_difference_is_shown_until_it_is_known_again() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    let mut cycles = Vec::new();
    for i in 0..600 {
        // One command a cycle, then a burst that does not fit into the FIFO, then none until the FIFO has run empty, then one a
        // cycle again.
        let commands = match i {
            0..100 => 1,
            100 => 300,
            101..300 => 0,
            _ => 1,
        };
        for k in 0..commands {
            board.send(&[10 * (i + k)]);
        }
        board.cycle();
        cycles.push((board.seconds(), board.targets[0] - board.positions[0]));
    }
    let plot = Recorded::new(&board).plot(&["--difference"]);
    let samples = plot.panel("Following difference").samples(COLOURS[0], false);
    let whole = f64::from(cycles.iter().map(|(_, difference)| difference.abs()).max().expect("cycles"));
    for (seconds, shown) in &samples {
        let nearest = cycles.iter().min_by(|a, b| (a.0 - seconds).abs().total_cmp(&(b.0 - seconds).abs()));
        near(*shown, f64::from(nearest.expect("cycles").1), whole);
    }
    let lost = (cycles[100].0, cycles[299].0);
    assert!(samples.iter().all(|(seconds, _)| *seconds < lost.0 - 0.0005 || *seconds > lost.1), "shown while unknown");
    assert!(samples.iter().any(|(seconds, _)| *seconds > lost.1 + 0.1), "never known again");
}

/// After a clear of the FIFO the targets in force are those sent with the clear and later.
#[test]
fn after_a_clear_the_difference_is_to_the_targets_sent_later() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    for i in 0..50 {
        board.send(&[1000 + i]);
    }
    board.clear();
    // The frame with the clear is itself an entry of the FIFO, so this report comes before its execution. Targets from before
    // the clear must not count as executed.
    board.report(MasterState::Op);
    for i in 0..100 {
        board.send(&[i]);
        board.cycle();
    }
    let plot = Recorded::new(&board).plot(&["--difference"]);
    let samples = plot.panel("Following difference").samples(COLOURS[0], false);
    assert!(samples.iter().all(|(_, difference)| difference.abs() < 100.0), "{samples:?}");
}
