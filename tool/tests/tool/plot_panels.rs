//! `ecmsk plot`: IO, velocity, the plane of two axes, units, the title, and the choice of diagrams.

use crate::common::motion::FakeBoard;
use crate::common::plots::{Recorded, near, two_axes};
use crate::common::svg::{COLOURS, IN_OUT};
use ecmsk::sk::{CommandId, IoResponse, Motion, SlaveCommand, SlaveKind, SlaveResponse, SlotSize};

const GET_STATUS: u8 = 0x00;

/// The slot of an IO slave that answers the command `id`, with these bits as inputs or outputs.
fn io(id: u8, bits: u16) -> ecmsk::sk::RawSlot {
    IoResponse { head: SlaveResponse { id, index: 0 }, bits }.encode()
}

/// A run of a drive that moves, and of an IO slave whose input 3 goes up and whose output 15 goes up and down. Also returns the
/// times at which the output goes up, the output goes down, and the input goes up.
fn with_io() -> (FakeBoard, [f64; 3]) {
    let mut run = FakeBoard::of_kinds(SlotSize::Bytes12, &[SlaveKind::Drive, SlaveKind::Io]);
    let mut times = [0.0; 3];
    run.slots.insert(2, io(GET_STATUS, 0));
    for i in 0..300 {
        run.slots.insert(2, io(GET_STATUS, if i >= 200 { 1 << 3 } else { 0 }));
        match i {
            100 | 150 => run.send_to(2, &SlaveCommand::IoWrite(if i == 100 { 1 << 15 } else { 0 })),
            _ => run.send_to(1, &SlaveCommand::Csp(Motion::to(10 * i))),
        }
        // The board begins to execute only now, so that from here on ten commands wait in the FIFO.
        if i >= 10 {
            run.cycle();
            match i {
                110 => times[0] = run.seconds(),
                160 => times[1] = run.seconds(),
                200 => times[2] = run.seconds(),
                _ => {}
            }
        }
    }
    (run, times)
}

/// An IO slave has no position: its inputs and outputs are shown, inputs when they were reported, outputs when their
/// command was executed, and bits that are always 0 are left out. The slave is shown by default if a bit was ever 1,
/// and if it is asked for.
#[test]
fn an_io_slave_shows_inputs_when_reported_and_outputs_when_executed() {
    let (run, [up, down, input]) = with_io();
    let recorded = Recorded::new(&run);
    for options in [&[][..], &["--axes", "1,2"], &["--axes", "2"], &["--panels", "io"]] {
        let plot = recorded.plot(options);
        assert!(!plot.panel_names().iter().any(|name| name.starts_with("Axis 2")), "{:?}", plot.panel_names());
        let panel = plot.panel("IO 2");
        assert_eq!(panel.lanes().iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["in 3", "out 15"]);
        let is = |found: &[(f64, bool)], expected: &[(f64, bool)]| {
            let near = |a: &(f64, bool), b: &(f64, bool)| (a.0 - b.0).abs() < 0.0015 && a.1 == b.1;
            assert!(
                found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| near(a, b)),
                "{found:?}, {expected:?}"
            );
        };
        is(&panel.edges("out 15", IN_OUT[1]), &[(up, true), (down, false)]);
        is(&panel.edges("in 3", IN_OUT[0])[1..], &[(input, true)]);
    }
}

/// An IO slave without changes has no panel by default, and a list of commands does not affect its panel.
#[test]
fn an_io_slave_without_changes_has_no_panel() {
    let mut run = FakeBoard::of_kinds(SlotSize::Bytes12, &[SlaveKind::Drive, SlaveKind::Io]);
    for i in 0..100 {
        run.slots.insert(2, io(GET_STATUS, 0));
        run.send(&[10 * i]);
        run.cycle();
    }
    let recorded = Recorded::new(&run);
    let names = ["Axis 1: position (counts)", "Torque (% of rated)", "FIFO: free entries of 160"];
    assert_eq!(recorded.plot(&[]).panel_names(), names);
    assert_eq!(recorded.plot(&["--axes", "2"]).panel_names(), ["FIFO: free entries of 160"]);
    recorded.try_plot(&["--axes", "2", "--panels", "io"]).expect_failure(
        1,
        &["nothing for the diagrams io"],
        "or leave it out",
    );
    recorded.try_plot(&["--xy", "1,2"]).expect_failure(1, &["slave 2 is IO and has no position"], "as in --xy 1,2");
}

/// The diagram has the velocity of the positions, per second, and behind it that of the targets; it is shown on
/// request.
#[test]
fn the_velocity_of_positions_and_targets_is_shown_if_asked_for() {
    let (run, cycles) = two_axes();
    let recorded = Recorded::new(&run);
    let plot = recorded.plot(&["--panels", "velocity"]);
    assert_eq!(plot.panel_names(), ["Velocity (counts/s; pale: of the targets)"]);
    let panel = plot.panel("Velocity");
    let at = cycles[700].seconds;
    // The axes move by 10 and 20 counts in each cycle of 1 ms.
    near(panel.at(COLOURS[0], true, at), 10_000.0, 10_000.0);
    near(panel.at(COLOURS[1], true, at), 20_000.0, 20_000.0);
    let gone = cycles[702].position[1] - cycles[697].position[1];
    near(panel.at(COLOURS[1], false, at), f64::from(gone) / 0.005, 100_000.0);
    assert!(!recorded.plot(&[]).panel_names().iter().any(|name| name.starts_with("Velocity")));
}

/// A drive in CSV shows its velocity by default, and the target at the cycle in which it was executed.
#[test]
fn a_drive_in_csv_shows_its_velocity() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    let mut changed = 0.0;
    for i in 0..200 {
        run.send_to(1, &SlaveCommand::Csv(Motion::to(if i < 100 { 500 } else { 900 })));
        if i >= 20 {
            run.positions[0] += 7;
            run.targets[0] = run.positions[0];
            run.cycle();
        }
        if i == 120 {
            changed = run.seconds();
        }
    }
    let plot = Recorded::new(&run).plot(&[]);
    let panel = plot.panel("Target velocity");
    near(panel.at(COLOURS[0], true, changed - 0.002), 500.0, 400.0);
    near(panel.at(COLOURS[0], true, changed + 0.002), 900.0, 400.0);
    assert!(plot.panel_names().contains(&"Velocity (counts/s; pale: of the targets)"));
}

/// The diagram `xy` shows the commanded and the actual path of two axes in their plane: the first axis horizontal, both to the
/// same scale.
#[test]
fn the_plane_shows_two_axes_to_the_same_scale() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 3);
    for i in 0..400 {
        let side = (i % 100) * 100;
        let [x, y] = match i / 100 {
            0 => [2 * side, 0],
            1 => [20_000, side],
            2 => [20_000 - 2 * side, 10_000],
            _ => [0, 10_000 - side],
        };
        run.send(&[y, 0, x]);
        run.cycle();
    }
    let recorded = Recorded::new(&run);
    let plot = recorded.plot(&["--xy", "3,1"]);
    assert_eq!(plot.panel_names().last(), Some(&"Plane of axes 3 and 1: position of axis 1 (counts)"));
    let panel = plot.panel("Plane");
    let corners = panel.samples(COLOURS[2], true);
    for corner in [(0.0, 0.0), (19_800.0, 0.0), (20_000.0, 9_900.0), (200.0, 10_000.0)] {
        assert!(corners.iter().any(|(x, y)| (x - corner.0).hypot(y - corner.1) < 60.0), "{corner:?}");
    }
    assert!(!panel.samples(COLOURS[2], false).is_empty());
    let drawn: Vec<(f64, f64)> = panel.lines(COLOURS[2], true).into_iter().flatten().collect();
    let span = |of: fn(&(f64, f64)) -> f64| {
        drawn.iter().map(of).fold(f64::MIN, f64::max) - drawn.iter().map(of).fold(f64::MAX, f64::min)
    };
    near(span(|point| point.0), 2.0 * span(|point| point.1), 100.0 * 8.0);
    assert!(plot.texts().contains(&"position of axis 3 (counts)") && plot.texts().contains(&"time (s)"));
    // The diagram `xy` shows the first two axes, unless `--xy` names others.
    assert_eq!(
        recorded.plot(&["--panels", "xy"]).panel_names(),
        ["Plane of axes 1 and 2: position of axis 2 (counts)"]
    );
    recorded.try_plot(&["--panels", "xy", "--axes", "1"]).expect_failure(
        1,
        &["needs two axes", "shows 1"],
        "as in --xy 1,2",
    );
    recorded.try_plot(&["--xy", "1,9"]).expect_failure(1, &["axis 9 is empty"], "--axes");
    recorded.try_plot(&["--xy", "a,b"]).expect_failure(1, &["axis `a`", "there is no machine file"], "--machine FILE");
    for wrong in ["1", "1,1", "1,2,3", "0,1", "1a,b"] {
        recorded.try_plot(&["--xy", wrong]).expect_misuse(&["--xy", "as in 1,2"]);
    }
}

/// Positions, differences and velocities are in units if the counts per unit are given, for all axes or for some.
#[test]
fn values_are_in_units_if_counts_per_unit_are_given() {
    let (run, cycles) = two_axes();
    let recorded = Recorded::new(&run);
    let plot = recorded.plot(&["--counts-per-unit", "1=1000,2=-500", "--unit", "mm", "--difference"]);
    let at = &cycles[600];
    near(
        plot.panel("Axis 1: position (mm)").at(COLOURS[0], false, at.seconds),
        f64::from(at.position[0]) / 1000.0,
        10.0,
    );
    near(plot.panel("Axis 2: position (mm)").at(COLOURS[1], true, at.seconds), f64::from(at.target[1]) / -500.0, 40.0);
    let difference = f64::from(at.target[0] - at.position[0]) / 1000.0;
    near(plot.panel("Following difference (mm)").at(COLOURS[0], false, at.seconds), difference, 0.4);
    let plot = recorded.plot(&["--counts-per-unit", "10"]);
    assert_eq!(plot.panel_names()[0], "Axis 1: position (units)");
    recorded.try_plot(&["--unit", "mm"]).expect_misuse(&["--counts-per-unit"]);
    recorded.try_plot(&["--counts-per-unit", "0"]).expect_misuse(&["--counts-per-unit"]);
}

/// A title replaces the link, whatever it contains.
#[test]
fn a_title_replaces_the_link() {
    let (run, _) = two_axes();
    let plot = Recorded::new(&run).plot(&["--title", "Press 4, <b>after</b> the repair"]);
    assert_eq!(plot.texts()[0], "Press 4, <b>after</b> the repair");
    assert!(!plot.texts().iter().any(|text| text.starts_with("sim:")));
}

/// Only the requested diagrams are shown.
#[test]
fn only_the_panels_asked_for_are_shown() {
    let (run, _) = two_axes();
    let recorded = Recorded::new(&run);
    assert_eq!(recorded.plot(&["--panels", "fifo"]).panel_names(), ["FIFO: free entries of 160"]);
    assert_eq!(
        recorded.plot(&["--panels", "difference,position", "--axes", "2"]).panel_names(),
        ["Axis 2: position (counts)", "Following difference (counts)"]
    );
    recorded.try_plot(&["--panels", "speed"]).expect_misuse(&["speed", "velocity"]);
    assert_eq!(CommandId::from_code(GET_STATUS), CommandId::GetStatus);
}
