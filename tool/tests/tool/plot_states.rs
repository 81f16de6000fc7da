//! `ecmsk plot`: where a drive is homing, has a fault or is not enabled.

use crate::common::motion::{ATTAINED, CSP, DriveSlot, ENABLED, FAULTED, FakeBoard, GO_HOME, UNDER_WAY};
use crate::common::plots::{Recorded, spans_are};
use crate::common::svg::{COLOURS, Panel, STATES};
use ecmsk::sk::{SlaveCommand, SlaveKind, SlotSize};

const FAULT: &str = STATES[0];
const HOMING: &str = STATES[1];
const NOT_ENABLED: &str = STATES[2];

/// Statuswords in homing mode, both of them in Operation enabled: the drive stands before the start, homing has failed.
const STANDS: u16 = 0x0637;
const ERROR: u16 = 0x2637;
/// Statuswords of the states Fault reaction active and Switch on disabled.
const REACTION: u16 = 0x021F;
const DISABLED: u16 = 0x0250;

const ABORT_HOME: u8 = 0x19;

/// Runs `cycles` cycles in which the slot of the slave's drive has this id and statusword. Returns their beginning and end in
/// seconds; the end is the time of the next report, the first one with other values.
fn say(run: &mut FakeBoard, slave: usize, id: u8, statusword: u16, cycles: u32) -> (f64, f64) {
    run.drives[slave - 1] = DriveSlot { id, statusword, ..run.drives[slave - 1] };
    run.cycle();
    let from = run.seconds();
    for _ in 1..cycles {
        run.cycle();
    }
    (from, run.seconds() + 0.001)
}

/// Asserts that the areas of a colour have these beginnings and ends in seconds, with a tolerance of 1.5 ms.
#[track_caller]
fn are(panel: &Panel<'_>, colour: &str, expected: &[(f64, f64)]) {
    spans_are(&panel.spans(colour), expected, 0.0015);
}

/// SK-7.20 A drive is homing from the answer to GO_HOME until bits 10 and 12 are both 1; the other drive is not. Bits
/// 10 and 12 of an earlier homing, which are still set at first, do not end it.
#[test]
fn homing_lasts_from_go_home_until_bits_10_and_12_are_set() {
    for first in [STANDS, ATTAINED, UNDER_WAY] {
        let mut run = FakeBoard::new(SlotSize::Bytes12, 2);
        say(&mut run, 2, CSP, ENABLED, 100);
        run.send_to(2, &SlaveCommand::GoHome);
        let (from, _) = say(&mut run, 2, GO_HOME, first, 3);
        say(&mut run, 2, GO_HOME, UNDER_WAY, 100);
        // From here on the host sends no command, so the slot no longer answers GO_HOME. The drive is still homing.
        let (_, to) = say(&mut run, 2, 0, UNDER_WAY, 100);
        say(&mut run, 2, 0, ATTAINED, 100);
        say(&mut run, 2, CSP, ENABLED, 100);
        let plot = Recorded::new(&run).plot(&["--axes", "1,2"]);
        are(&plot.panel("Axis 2"), HOMING, &[(from, to)]);
        are(&plot.panel("Axis 1"), HOMING, &[]);
        assert_eq!(plot.panel("Axis 2").notes(), []);
        assert_eq!(plot.texts().iter().filter(|text| **text == "homing").count(), 1, "in the legend of axis 2");
    }
}

/// SK-7.39 A drive that is home at once shows bits 10 and 12 from the first report on: they count when they have stood
/// for 20 ms. The next GO_HOME is seen although the host has sent no other command meanwhile.
#[test]
fn a_drive_that_is_home_at_once_is_seen_and_so_is_its_next_homing() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    say(&mut run, 1, CSP, ENABLED, 50);
    run.send_to(1, &SlaveCommand::GoHome);
    let (first, _) = say(&mut run, 1, GO_HOME, ATTAINED, 200);
    run.send_to(1, &SlaveCommand::GoHome);
    let (second, to) = say(&mut run, 1, GO_HOME, UNDER_WAY, 100);
    say(&mut run, 1, GO_HOME, ATTAINED, 50);
    let plot = Recorded::new(&run).plot(&[]);
    are(&plot.panel("Axis 1"), HOMING, &[(first, first + 0.020), (second, to)]);
}

/// SK-7.21 Bit 13 ends homing and is marked; ABORT_HOME in another slave's slot, a fault, SV_OFF and leaving OP end it,
/// too.
#[test]
fn an_error_an_abort_a_fault_and_leaving_op_end_homing() {
    let ends: [fn(&mut FakeBoard); 5] = [
        |run| _ = say(run, 1, 0, ERROR, 50),
        |run| _ = say(run, 2, ABORT_HOME, ENABLED, 50),
        |run| _ = say(run, 1, 0, FAULTED, 50),
        |run| _ = say(run, 1, 0x12, DISABLED, 50),
        |run| (0..50).for_each(|_| run.report(ecmsk::sk::MasterState::SafeOp)),
    ];
    for (i, end) in ends.into_iter().enumerate() {
        let mut run = FakeBoard::new(SlotSize::Bytes12, 2);
        say(&mut run, 1, CSP, ENABLED, 50);
        let (from, to) = say(&mut run, 1, GO_HOME, UNDER_WAY, 100);
        end(&mut run);
        say(&mut run, 2, 0, ENABLED, 1);
        say(&mut run, 1, 0, ENABLED, 100);
        let plot = Recorded::new(&run).plot(&[]);
        let panel = plot.panel("Axis 1");
        are(&panel, HOMING, &[(from, to)]);
        let notes: Vec<&str> = panel.notes().into_iter().map(|(_, text)| text).collect();
        let expected: &[&str] = if i == 0 { &["homing error"] } else { &[] };
        // In this test the fault has no error code, so there is no note.
        assert_eq!(notes, expected, "end {i}");
    }
}

/// SK-7.30 A GO_HOME that is rejected is not answered, and no homing begins.
#[test]
fn a_rejected_go_home_begins_no_homing() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    run.send_to(1, &SlaveCommand::GoHome);
    say(&mut run, 1, 0, UNDER_WAY, 100);
    are(&Recorded::new(&run).plot(&[]).panel("Axis 1"), HOMING, &[]);
}

/// LIB-25 A fault is shown from the reaction to it until it is cleared, with its error code, which may come later; from
/// there on the drive is not enabled until it is on again. Earlier targets are not in force any more.
#[test]
fn a_fault_is_shown_with_its_code_until_it_is_cleared() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    run.send(&[5000]);
    say(&mut run, 1, CSP, ENABLED, 100);
    let (from, _) = say(&mut run, 1, CSP, REACTION, 10);
    run.drives[0].error_code = 0x7500;
    let (_, to) = say(&mut run, 1, CSP, FAULTED, 100);
    run.drives[0].error_code = 0;
    let off = say(&mut run, 1, 0x10, DISABLED, 100);
    say(&mut run, 1, 0x11, ENABLED, 50);
    run.send(&[6000]);
    say(&mut run, 1, CSP, ENABLED, 50);
    let plot = Recorded::new(&run).plot(&[]);
    let panel = plot.panel("Axis 1");
    are(&panel, FAULT, &[(from, to)]);
    are(&panel, NOT_ENABLED, &[off]);
    let notes = panel.notes();
    assert_eq!(notes.iter().map(|(_, text)| *text).collect::<Vec<_>>(), ["alarm 0x7500: communication"]);
    assert!((from..from + 0.01).contains(&notes[0].0), "{notes:?}");
    let targets = panel.lines(COLOURS[0], true);
    assert_eq!(targets.len(), 2, "nothing leads from the target before to the one after: {targets:?}");
    for name in ["fault", "not enabled"] {
        assert!(plot.texts().contains(&name), "{name}");
    }
}

/// SK-3.21 The slot of an HSP has no error code. The bytes at that place are not shown as one.
#[test]
fn a_fault_of_an_hsp_has_no_error_code() {
    let mut run = FakeBoard::of_kind(SlotSize::Bytes12, 1, SlaveKind::Hsp);
    say(&mut run, 1, CSP, ENABLED, 50);
    run.drives[0].error_code = 0x1234;
    say(&mut run, 1, CSP, FAULTED, 50);
    let plot = Recorded::new(&run).plot(&[]);
    let panel = plot.panel("Axis 1");
    let notes: Vec<&str> = panel.notes().into_iter().map(|(_, text)| text).collect();
    assert_eq!(notes, ["fault"]);
}

/// A drive that was on all the time has no shading and no note about it.
#[test]
fn a_drive_that_was_on_all_the_time_has_no_shading() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    say(&mut run, 1, CSP, ENABLED, 100);
    let plot = Recorded::new(&run).plot(&[]);
    for colour in STATES {
        are(&plot.panel("Axis 1"), colour, &[]);
    }
    assert!(!plot.texts().iter().any(|text| ["fault", "homing", "not enabled"].contains(text)));
}

/// A state that lasts beyond the requested time is drawn up to its limits. A state of one cycle is still visible. Notes overlap
/// nothing and are not cut. Thousands of faults do not make a picture of thousands of areas.
#[test]
fn short_states_are_seen_and_thousands_of_faults_stay_readable() {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 1);
    for i in 0..20_000 {
        run.drives[0].error_code = if i % 2 == 0 { 0x7500 } else { 0 };
        say(&mut run, 1, CSP, if i % 2 == 0 { FAULTED } else { ENABLED }, 1);
    }
    say(&mut run, 1, CSP, ENABLED, 5000);
    let (from, _) = say(&mut run, 1, CSP, DISABLED, 1);
    for code in [0x8611, 0x7305, 0x8611] {
        say(&mut run, 1, CSP, ENABLED, 200);
        run.drives[0].error_code = code;
        say(&mut run, 1, CSP, FAULTED, 200);
    }
    say(&mut run, 1, CSP, ENABLED, 100);
    let (last, end) = say(&mut run, 1, CSP, FAULTED, 5);
    let recorded = Recorded::new(&run);
    let plot = recorded.plot(&[]);
    let panel = plot.panel("Axis 1");
    assert!(panel.spans(FAULT).len() < 1100, "{}", panel.spans(FAULT).len());
    assert_eq!(panel.spans(NOT_ENABLED).len(), 1);
    let (left, right) = panel.spans(NOT_ENABLED)[0];
    assert!((left - from).abs() < 0.03 && right - left > 0.015, "{left} to {right}");
    plot.assert_labels_are_readable();
    assert!(panel.notes().iter().any(|(_, text)| *text == "alarm 0x8611"), "{:?}", panel.notes());

    let (a, b) = (format!("{:.3}", last - 0.004), format!("{:.3}", last + 0.002));
    let part = recorded.plot(&["--from", &a, "--to", &b]);
    are(&part.panel("Axis 1"), FAULT, &[(last, last + 0.002)]);
    assert!(last + 0.002 < end);
    let (a, b) = (format!("{:.3}", last + 0.001), format!("{:.3}", last + 0.003));
    let part = recorded.plot(&["--from", &a, "--to", &b]);
    assert_eq!(part.panel("Axis 1").spans(FAULT).len(), 1);
    let (left, right) = part.panel("Axis 1").spans(FAULT)[0];
    assert!((left - last - 0.001).abs() < 2e-4 && (right - last - 0.003).abs() < 2e-4, "{left} to {right}");
}
