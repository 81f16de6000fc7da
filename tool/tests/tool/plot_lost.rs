//! `ecmsk plot`: a lost slave, targets that were never executed, homing's change of coordinates, and many axes.

use crate::common::motion::{ATTAINED, CSP, DriveSlot, FakeBoard, GO_HOME, UNDER_WAY, go};
use crate::common::plots::{Recorded, spans_are};
use crate::common::svg::{COLOURS, Panel, Plot};
use ecmsk::sk::{MasterState, SlaveCommand, SlaveKind, SlotSize};

const LOST: &str = "#B4BAC6";
const FAILED: &str = "#FBC98E";
const ALARM: &str = "#D01020";

#[track_caller]
fn near(found: &[(f64, f64)], expected: &[(f64, f64)]) {
    spans_are(found, expected, 0.004);
}

/// Whether the curve of a colour has a point between the times `from` and `to`, in seconds.
fn has_points(panel: &Panel<'_>, colour: &str, pale: bool, from: f64, to: f64) -> bool {
    panel.samples(colour, pale).iter().any(|(at, _)| from + 0.01 < *at && *at < to - 0.01)
}

/// SK-4.61 TOOL-197 A slave that is lost in state 0x18 is shaded and named; neither the old values of its slot nor
/// targets that were never executed are drawn; the others go on; the state has a mark in all panels over time.
#[test]
fn a_lost_slave_is_shown() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 2);
    go(&mut run, 0..300);
    run.lost = vec![2];
    go(&mut run, 300..301);
    let from = run.seconds();
    go(&mut run, 301..600);
    run.lost.clear();
    go(&mut run, 600..601);
    let to = run.seconds();
    go(&mut run, 601..900);
    let plot = Recorded::new(&run).plot(&[]);
    let (first, second) = (plot.panel("Axis 1"), plot.panel("Axis 2"));
    near(&second.spans(LOST), &[(from, to)]);
    near(&first.spans(LOST), &[]);
    assert_eq!(second.notes().into_iter().map(|(_, note)| note).collect::<Vec<_>>(), ["lost"]);
    for pale in [true, false] {
        assert!(!has_points(&second, COLOURS[1], pale, from, to), "a line of the lost axis, pale: {pale}");
        assert!(has_points(&second, COLOURS[1], pale, to, run.seconds()), "it is back");
        assert!(has_points(&first, COLOURS[0], pale, from, to), "the other one goes on");
    }
    for panel in [&first, &second] {
        let marks = panel.samples(ALARM, false);
        assert!(marks.len() == 2 && marks.iter().all(|(at, _)| (at - from).abs() < 0.004), "{marks:?}");
    }
    let fifo = plot.panel("FIFO");
    near(&fifo.spans(FAILED), &[(from, to)]);
    assert_eq!(fifo.notes().into_iter().map(|(_, note)| note).collect::<Vec<_>>(), ["0x18"]);
    let texts = plot.texts();
    assert!(texts.contains(&"lost: slot without news in state 0x18") && texts.contains(&"state 0x18"), "{texts:?}");
}

/// TOOL-197 A slave at rest in state 0x18 may or may not be lost: it is marked "lost?" until it moves.
#[test]
fn a_slave_that_stands_still_may_be_lost() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 2);
    (0..300).for_each(|_| run.cycle());
    run.lost = vec![2];
    run.cycle();
    let from = run.seconds();
    (0..300).for_each(|_| run.cycle());
    // Axis 1 has also stood still, but is not lost, since it moves later.
    for n in 0..300 {
        run.send(&[10 * n, 0]);
        run.cycle();
    }
    let plot = Recorded::new(&run).plot(&[]);
    near(&plot.panel("Axis 1").spans(LOST), &[]);
    near(&plot.panel("Axis 2").spans(LOST), &[(from, run.seconds())]);
    let panel = plot.panel("Axis 2");
    assert_eq!(panel.notes().into_iter().map(|(_, note)| note).collect::<Vec<_>>(), ["lost?"]);
}

fn answer(run: &mut FakeBoard, id: u8, statusword: u16) {
    run.drives[0] = DriveSlot { id, statusword, ..run.drives[0] };
}

/// SK-7.26 SK-7.37 TOOL-198 Targets that the board ignores from GO_HOME on, until its slot answers a motion command again, are not
/// drawn as executed.
#[test]
fn targets_that_are_ignored_are_not_drawn() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    for n in 0..200 {
        run.send(&[10 * n]);
        run.cycle();
    }
    run.send_to(1, &SlaveCommand::GoHome);
    answer(&mut run, GO_HOME, UNDER_WAY);
    run.cycle();
    let from = run.seconds();
    let targets = |run: &mut FakeBoard, cycles: u32| {
        for _ in 0..cycles {
            run.send(&[5_000]);
            run.targets = vec![0];
            run.cycle();
        }
    };
    targets(&mut run, 100);
    // Home is attained, and the board writes the mode back for 50 cycles.
    answer(&mut run, GO_HOME, ATTAINED);
    targets(&mut run, 50);
    let to = run.seconds();
    answer(&mut run, CSP, ATTAINED);
    for n in 0..200 {
        run.send(&[10 * n]);
        run.cycle();
    }
    let plot = Recorded::new(&run).plot(&[]);
    let panel = plot.panel("Axis 1");
    assert!(!has_points(&panel, COLOURS[0], true, from, to), "{:?}", panel.samples(COLOURS[0], true));
    assert!(has_points(&panel, COLOURS[0], true, to, run.seconds()));
    let greatest = panel.samples(COLOURS[0], true).into_iter().map(|(_, value)| value).fold(0.0, f64::max);
    assert!(greatest < 2_500.0, "{greatest}: 5000 was never executed");
}

/// Homing changes the zero of positions: the line is broken there, and the vertical axis fits the later positions.
#[test]
fn another_zero_breaks_the_line_and_sets_the_scale() {
    let mut run = FakeBoard::starting(SlotSize::Bytes12, 1, SlaveKind::Drive);
    (run.positions, run.targets) = (vec![1_300_000], vec![1_300_000]);
    [MasterState::SafeOp, MasterState::Op].into_iter().for_each(|state| run.report(state));
    (0..200).for_each(|_| run.cycle());
    run.send_to(1, &SlaveCommand::GoHome);
    answer(&mut run, GO_HOME, UNDER_WAY);
    for n in 0..200 {
        (run.positions, run.targets) = (vec![1_300_000 - 100 * n], vec![1_300_000 - 100 * n]);
        run.cycle();
    }
    answer(&mut run, GO_HOME, ATTAINED);
    (run.positions, run.targets) = (vec![0], vec![0]);
    run.cycle();
    let zeroed = run.seconds();
    answer(&mut run, CSP, ATTAINED);
    for n in 0..300 {
        run.send(&[10 * n]);
        run.cycle();
    }
    let plot = Recorded::new(&run).plot(&[]);
    let points: Vec<(f64, f64)> = plot.panel("Axis 1").samples(COLOURS[0], false);
    assert!(points.iter().all(|(_, value)| (-500.0..4_000.0).contains(value)), "{points:?}");
    assert!(points.iter().all(|(at, _)| *at > zeroed - 0.004), "what was before is far away");
    let (low, high) = points.iter().fold((f64::MAX, f64::MIN), |(low, high), (_, v)| (low.min(*v), high.max(*v)));
    assert!(low < 10.0 && high > 2_500.0, "{low} to {high}");
    // If the positions before homing are within the range of the vertical axis, they are drawn, but their curve is not
    // connected with the later one.
    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    run.send_to(1, &SlaveCommand::GoHome);
    answer(&mut run, GO_HOME, UNDER_WAY);
    for n in 0..200 {
        (run.positions, run.targets) = (vec![10 * n], vec![10 * n]);
        run.cycle();
    }
    answer(&mut run, GO_HOME, ATTAINED);
    (run.positions, run.targets) = (vec![0], vec![0]);
    run.cycle();
    answer(&mut run, CSP, ATTAINED);
    for n in 0..6_000 {
        run.send(&[n]);
        run.cycle();
    }
    let plot = Recorded::new(&run).plot(&[]);
    let lines = plot.panel("Axis 1").lines(COLOURS[0], false);
    assert_eq!(lines.len(), 2, "in one column of pixels, and yet two");
}

/// With more than four axes every second line is dashed, and the common diagrams have the numbers of the axes at the
/// ends of the lines.
#[test]
fn many_axes_are_told_apart() {
    let of = |axes: usize| {
        let mut run = FakeBoard::new(SlotSize::Bytes12, axes);
        for n in 0..300 {
            let targets: Vec<i32> = (1..=axes as i32).map(|axis| axis * 10 * n).collect();
            run.send(&targets);
            run.cycle();
        }
        Recorded::new(&run).plot(&[])
    };
    let (few, many) = (of(4), of(8));
    let torque = many.panel("Torque");
    for (n, colour) in COLOURS.iter().enumerate() {
        let pieces = torque.lines(colour, false).len();
        assert_eq!(pieces > 10, n % 2 == 1, "axis {}: {pieces} pieces", n + 1);
    }
    let ends = |plot: &Plot| {
        let right =
            plot.labels.iter().filter(|label| label.anchor == "start" && label.x > plot.size.0 * 1172.0 / 1200.0);
        right.map(|label| label.text.clone()).collect::<Vec<_>>()
    };
    assert_eq!(ends(&many), ["8", "7", "6", "5", "4", "3", "2", "1"], "from the greatest torque to the least");
    assert!(ends(&few).is_empty());
    many.assert_labels_are_readable();
    assert!(few.panel("Torque").lines(COLOURS[1], false).len() < 10);
}
