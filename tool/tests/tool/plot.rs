//! `ecmsk plot`: recordings as pictures, read back from the SVG by the numbers at their axes.

use std::fs;
use std::path::Path;

use crate::common::motion::FakeBoard;
use crate::common::plots::{Recorded, near, two_axes};
use crate::common::recordings::make_capture;
use crate::common::run;
use crate::common::svg::{ALARM, COLOURS, FIFO, Plot};
use ecmsk::sk::{MasterState, SlaveKind, SlotSize};

/// Positions are drawn at their reports, targets at the cycle in which the board executed them, eight cycles after they
/// were sent; the legend says so.
#[test]
fn targets_and_positions() {
    let (run, cycles) = two_axes();
    let plot = Recorded::new(&run).plot(&[]);
    assert_eq!(
        plot.panel_names(),
        ["Axis 1: position (counts)", "Axis 2: position (counts)", "Torque (% of rated)", "FIFO: free entries of 160"]
    );
    for (axis, colour) in [(0, COLOURS[0]), (1, COLOURS[1])] {
        let panel = plot.panel(&format!("Axis {}", axis + 1));
        let whole = f64::from(10_000 * (axis as i32 + 1));
        for cycle in cycles.iter().skip(1).step_by(50) {
            near(panel.at(colour, false, cycle.seconds), cycle.position[axis].into(), whole);
            // The target that is sent at that time is eight cycles further, which is 0.8 % of the whole way. The tolerance of
            // 0.25 % is smaller.
            near(panel.at(colour, true, cycle.seconds), cycle.target[axis].into(), whole / 4.0);
        }
    }
    let texts = plot.texts();
    for text in [
        "sim:?slaves=drive*3&clock=virtual",
        "time (s)",
        "target, when executed",
        "actual",
        "axis 1",
        "axis 2",
        "free entries",
    ] {
        assert!(texts.contains(&text), "`{text}` is missing in {texts:?}");
    }
}

/// The plot shows torque in percent of the rated torque; the drive reports it in 0.1 %.
#[test]
fn torque_is_shown_in_percent_of_rated() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    for i in 0..200 {
        board.send(&[if i < 100 { 0 } else { 8000 }]);
        board.cycle();
    }
    let plot = Recorded::new(&board).plot(&[]);
    let highest =
        plot.panel("Torque").samples(COLOURS[0], false).into_iter().map(|(_, torque)| torque).fold(0.0, f64::max);
    // The target jumps by 8000 counts. The drive goes a tenth of the way at once, and its torque in 0.1 % is a quarter of the
    // distance that is left.
    near(highest, 7200.0 / 4.0 / 10.0, 180.0);
}

/// The plot shows no torque of an HSP (a pulse module), which has its inputs at that place in its slot.
#[test]
fn an_hsp_has_no_torque() {
    let mut board = FakeBoard::of_kind(SlotSize::Bytes12, 1, SlaveKind::Hsp);
    for i in 0..100 {
        board.send(&[100 * i]);
        board.cycle();
    }
    let plot = Recorded::new(&board).plot(&[]);
    assert_eq!(plot.panel_names(), ["Axis 1: position (counts)", "FIFO: free entries of 160"]);
}

/// The plot shows the level of the FIFO, and the times at which commands were lost.
#[test]
fn the_fifo_level_and_lost_commands_are_shown() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    let mut levels = Vec::new();
    for i in 0..300 {
        for _ in 0..if i == 100 { 175 } else { 1 } {
            board.send(&[i]);
        }
        board.cycle();
        levels.push((board.seconds(), 160 - board.waiting()));
    }
    let plot = Recorded::new(&board).plot(&[]);
    let panel = plot.panel("FIFO");
    for (seconds, free) in levels.iter().skip(1).step_by(20) {
        near(panel.at(FIFO, false, *seconds), f64::from(*free), 160.0);
    }
    let full = panel.lines(ALARM, false);
    // The full count rises in the report after the burst, and in one report for each later command that finds the FIFO full.
    // Each rise is a vertical line.
    assert!(!full.is_empty() && full.iter().all(|line| line[0].0 == line[1].0), "{full:?}");
    let first = panel.samples(ALARM, false).into_iter().map(|(seconds, _)| seconds).fold(f64::MAX, f64::min);
    near(first, levels[100].0, 0.3);
    assert!(plot.texts().iter().any(|text| text.starts_with("commands lost: the full count went up in ")));
}

/// Without losses the plot does not mention any.
#[test]
fn without_lost_commands_the_plot_does_not_mention_any() {
    let plot = Recorded::new(&two_axes().0).plot(&[]);
    assert_eq!(plot.panel("FIFO").lines(ALARM, false).len(), 0);
    assert!(!plot.texts().iter().any(|text| text.contains("lost")));
}

/// A target that is sent once stays until the next one: the line has a step, no slope.
#[test]
fn a_target_holds_until_the_next_one() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    for i in 0..400 {
        if i == 100 {
            board.send(&[1000]);
        } else if i == 300 {
            board.send(&[3000]);
        }
        board.cycle();
    }
    let plot = Recorded::new(&board).plot(&[]);
    let panel = plot.panel("Axis 1");
    let end = board.seconds();
    for (seconds, target) in [(end - 0.25, 1000.0), (end - 0.15, 1000.0), (end - 0.05, 3000.0), (end - 0.001, 3000.0)] {
        near(panel.at(COLOURS[0], true, seconds), target, 3000.0);
    }
}

/// One cycle out of thousands is still seen, and a line has no more points than a picture can show.
#[test]
fn long_recordings_are_thinned_without_loss() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    for i in 0..30_000 {
        if i == 12_345 {
            board.positions[0] = 100_000;
        }
        board.cycle();
        board.positions[0] = 0;
    }
    let recorded = Recorded::new(&board);
    let svg = recorded.try_plot(&["-o", "-"]).expect_quiet();
    assert!(svg.len() < 500_000, "{} bytes", svg.len());
    let plot = Plot::parse(&svg);
    let samples = plot.panel("Axis 1").samples(COLOURS[0], false);
    assert!(samples.len() <= 4 * 1200, "{} points", samples.len());
    let (at, highest) = samples.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("samples");
    near(highest, 90_000.0, 90_000.0);
    near(at, board.seconds() - 17.654, 30.0);
}

/// The plot has the requested axes and time.
#[test]
fn axes_and_time_can_be_chosen() {
    let (run, cycles) = two_axes();
    let recorded = Recorded::new(&run);
    let plot = recorded.plot(&["--axes", "2", "--from", "0.4", "--to", "0.5"]);
    assert_eq!(plot.panel_names()[..2], ["Axis 2: position (counts)", "Torque (% of rated)"]);
    let panel = plot.panel("Axis 2");
    let samples = panel.samples(COLOURS[1], false);
    assert!(samples.iter().all(|(seconds, _)| (0.3995..0.5005).contains(seconds)), "{samples:?}");
    for cycle in cycles.iter().filter(|cycle| (0.402..0.498).contains(&cycle.seconds)) {
        near(panel.at(COLOURS[1], false, cycle.seconds), cycle.position[1].into(), 2000.0);
        near(panel.at(COLOURS[1], true, cycle.seconds), f64::from(cycle.target[1]), 2000.0);
    }
    assert!(plot.texts().iter().any(|text| text.starts_with("0.4 to 0.5 s of ")), "{:?}", plot.texts());
}

/// A plot shows at most eight axes, in eight colours; a note says which eight of a larger number.
#[test]
fn eight_axes_have_colours_and_further_ones_are_left_out_by_name() {
    let board = |axes: usize| {
        let mut board = FakeBoard::new(SlotSize::Bytes12, axes);
        for i in 0..50 {
            board.send(&vec![i; axes]);
            board.cycle();
        }
        Recorded::new(&board)
    };
    let plot = board(8).plot(&["--difference"]);
    for (axis, colour) in (1..).zip(COLOURS) {
        assert!(!plot.panel(&format!("Axis {axis}")).lines(colour, false).is_empty(), "axis {axis}");
        assert!(!plot.panel("Torque").lines(colour, false).is_empty(), "axis {axis}");
        assert!(!plot.panel("Following").lines(colour, false).is_empty(), "axis {axis}");
    }
    let ten = board(10);
    let ran = ten.try_plot(&["-o", "-"]);
    assert_eq!(ran.code, Some(0));
    assert_eq!(ran.err, "note: 10 axes, of which the plot shows 1, 2, 3, 4, 5, 6, 7, 8; choose others with --axes\n");
    assert_eq!(Plot::parse(&ran.out).panel_names().len(), 8 + 2);
    let plot = ten.plot(&["--axes", "10,1"]);
    assert_eq!(plot.panel_names()[..2], ["Axis 1: position (counts)", "Axis 10: position (counts)"]);
    ten.try_plot(&["--axes", "1,2,3,4,5,6,7,8,9"]).expect_failure(1, &["9 axes", "at most 8"], "--axes");
}

/// No text overlaps another one or leaves the picture, whatever the numbers are.
#[test]
fn labels_neither_overlap_nor_leave_the_picture() {
    for (axes, scale, options) in
        [(1, 0, &[][..]), (2, 1, &["--difference"]), (8, 250_000_000, &["--difference"]), (3, 7, &["--to", "0.0095"])]
    {
        let mut board = FakeBoard::new(SlotSize::Bytes12, axes);
        for i in 0..200 {
            for _ in 0..if i == 20 { 170 } else { 1 } {
                board.send(&(1..=axes as i32).map(|axis| (i % 9 - 4) * axis * (scale / 8)).collect::<Vec<_>>());
            }
            board.cycle();
        }
        let plot = Recorded::of_link(&board, &format!("sim:?name={}", "n".repeat(60))).plot(options);
        assert!((800.0..=1600.0).contains(&plot.page.0) && (300.0..=2000.0).contains(&plot.page.1), "{:?}", plot.page);
        plot.assert_labels_are_readable();
    }
}

/// The plot is right also with 16-byte slots and with firmware 1.5, whose full count rises by the number of 4-byte words of a
/// lost frame: a frame that finds the FIFO full is lost, and its target is not drawn.
#[test]
fn slots_of_16_bytes_and_a_wide_full_count_give_the_same_plot() {
    let mut board = FakeBoard::new(SlotSize::Bytes16, 2);
    board.full_step = 128;
    for i in 0..100 {
        board.send(&[100 * i, -100 * i]);
        board.cycle();
    }
    for i in 0..161 {
        board.send(&[10_000 + i, -50_000 * (i / 160)]);
    }
    for _ in 0..170 {
        board.cycle();
    }
    let plot = Recorded::of_link(&board, "sim:?slot=16&fw=1.5").plot(&[]);
    let panel = plot.panel("Axis 2");
    near(panel.at(COLOURS[1], false, board.seconds()), board.positions[1].into(), 10_000.0);
    let lowest = panel.samples(COLOURS[1], true).into_iter().map(|(_, target)| target).fold(0.0, f64::min);
    near(lowest, -9_900.0, 20_000.0);
}

/// A report that was read late belongs to the moment when it was made: the plot is the same.
#[test]
fn a_report_that_was_read_late_is_plotted_when_it_was_made() {
    let (mut board, _) = two_axes();
    let plot = || -> Vec<_> {
        let plot = Recorded::new(&board).plot(&["--difference"]);
        plot.lines.into_iter().map(|line| (line.colour, line.pale, line.points)).collect()
    };
    let in_time = plot();
    board.script.read_late(60);
    let late = Recorded::new(&board).plot(&["--difference"]);
    let late: Vec<_> = late.lines.into_iter().map(|line| (line.colour, line.pale, line.points)).collect();
    assert_eq!(late, in_time);
}

/// Of the two boards in a capture the one that is in OP is plotted.
#[test]
fn of_two_boards_the_one_in_op_is_plotted() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    for i in 0..20 {
        board.send(&[1000 * i]);
        board.cycle();
    }
    // The recording has 4 frames on the way to OP, then a command and a report for each of 20 cycles.
    let (own, frames) = (board.positions[0], 4 + 2 * 20);
    for _ in 0..20 {
        board.positions[0] = -5000;
        board.cycle();
    }
    let recorded = Recorded::new(&board);
    let devices: Vec<u8> = (0..frames + 20).map(|k| if k < frames { 7 } else { 8 }).collect();
    make_capture(&recorded.file, &devices);
    let samples = recorded.plot(&[]).panel("Axis 1").samples(COLOURS[0], false);
    assert!(samples.iter().all(|(_, position)| *position > -500.0), "{samples:?}");
    near(samples.last().expect("samples").1, own.into(), 20_000.0);
}

/// Each note on a recording is printed once, although the recording is read twice.
#[test]
fn each_note_is_printed_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    // Without an axis and without CRCs the slot size is unknown.
    let mut board = FakeBoard::new(SlotSize::Bytes12, 0);
    board.cycle();
    board.script.leave_crc_out();
    board.script.record(&file, "usb:", None);
    let ran = run([Path::new("plot"), &file]);
    assert_eq!(ran.code, Some(0));
    assert_eq!(ran.err.matches("no CRC tells the slot size").count(), 1, "{}", ran.err);
}

/// When the network leaves OP the curves end; when it comes back they begin anew.
#[test]
fn outside_op_there_is_a_gap() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    for part in 0..2 {
        for i in 0..100 {
            board.send(&[1000 * part + i]);
            board.cycle();
        }
        for _ in 0..100 {
            board.report(MasterState::SafeOp);
        }
    }
    let plot = Recorded::new(&board).plot(&["--difference"]);
    assert_eq!(plot.panel("Axis 1").lines(COLOURS[0], false).len(), 2);
    assert_eq!(plot.panel("Axis 1").lines(COLOURS[0], true).len(), 2);
    assert_eq!(plot.panel("FIFO").lines(FIFO, false).len(), 2);
}

/// Without -o the plot is written beside the recording; its name is printed.
#[test]
fn without_an_output_the_plot_lies_beside_the_recording() {
    let recorded = Recorded::new(&two_axes().0);
    let beside = recorded.file.with_extension("svg");
    assert_eq!(recorded.try_plot(&[]).expect_quiet(), format!("{}\n", beside.display()));
    let other = recorded.file.with_file_name("other.svg");
    let name = other.to_str().expect("UTF-8");
    assert_eq!(recorded.try_plot(&["-o", name]).expect_quiet(), format!("{name}\n"));
    let read = |file: &Path| fs::read_to_string(file).expect("a plot");
    assert_eq!(read(&beside), read(&other));
    assert_eq!(read(&beside), recorded.try_plot(&["-o", "-"]).expect_quiet());
}

/// Whatever a link or a file's name contains, the SVG stays well-formed.
#[test]
fn names_with_markup_do_not_break_the_svg() {
    let (board, _) = two_axes();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("<a & \"b\">\u{1}\u{7f}'.pcapng");
    board.script.record(&file, "usb:?serial=</svg>&x=]]>", None);
    let plot = Plot::parse(&run([Path::new("plot"), &file, Path::new("-o"), Path::new("-")]).expect_quiet());
    assert!(plot.texts().iter().any(|text| text.contains("<a & \"b\">\u{fffd}\u{fffd}'.pcapng")), "{:?}", plot.texts());
}

/// A recording that cannot be plotted is an error with the next step.
#[test]
fn what_cannot_be_plotted_is_an_error_with_the_next_step() {
    let (board, _) = two_axes();
    let recorded = Recorded::new(&board);
    let end = format!("in OP from 0.002 s to {:.3} s", board.seconds());
    recorded.try_plot(&["--from", "9"]).expect_failure(1, &["asked for 9 s and later", &end], "change --from or --to");
    recorded.try_plot(&["--to", "-1"]).expect_failure(1, &["asked for all until -1 s", &end], "change --from or --to");
    recorded.try_plot(&["--from", "0.5", "--to", "0.4"]).expect_failure(
        1,
        &["0.5 s to 0.4 s"],
        "change --from or --to",
    );
    recorded.try_plot(&["--axes", "0"]).expect_misuse(&["--axes"]);
    recorded.try_plot(&["--axes", "41"]).expect_misuse(&["--axes"]);
    recorded.try_plot(&["--axes", "31", "--slot-size", "16"]).expect_failure(
        1,
        &["axis 31", "16-byte"],
        "from 1 to 30 with --axes",
    );
    recorded.try_plot(&["-o", "/no/such/folder/x.svg"]).expect_failure(
        1,
        &["cannot write /no/such/folder/x.svg"],
        "with -o",
    );
    let same = recorded.file.to_str().expect("UTF-8");
    recorded.try_plot(&["-o", same]).expect_failure(1, &["would replace the recording"], "with -o");
    run(["plot", "-"]).expect_failure(1, &["cannot read standard input"], "name a file");
    run(["plot", "/no/such/file"]).expect_failure(1, &["/no/such/file: No such file"], "check the path");
    assert!(!recorded.file.with_extension("svg").exists(), "an error leaves nothing behind");
}

/// A recording that never gets to OP has nothing to plot.
#[test]
fn a_recording_without_op_has_nothing_to_plot() {
    let mut board = FakeBoard::starting(SlotSize::Bytes12, 1, SlaveKind::Drive);
    for _ in 0..20 {
        board.report(MasterState::PreOp);
    }
    let recorded = Recorded::new(&board);
    recorded.try_plot(&[]).expect_failure(1, &["no response in OP (22 frames)"], "look at this one with `ecmsk dump`");
}

/// A recording that was cut off is plotted up to its end, and a note says so.
#[test]
fn a_truncated_recording_is_plotted_as_far_as_it_goes() {
    let (board, cycles) = two_axes();
    let recorded = Recorded::new(&board);
    let whole = fs::read(&recorded.file).expect("a recording");
    fs::write(&recorded.file, &whole[..whole.len() / 2 + 1]).expect("a file");
    let ran = recorded.try_plot(&["-o", "-"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert!(ran.err.starts_with("note: ") && ran.err.contains("ends in the middle of the block"), "{}", ran.err);
    let early = &cycles[300];
    let plot = Plot::parse(&ran.out);
    near(plot.panel("Axis 1").at(COLOURS[0], false, early.seconds), early.position[0].into(), 10_000.0);
    fs::write(&recorded.file, &whole[..1500]).expect("a file");
    recorded.try_plot(&[]).expect_failure(1, &["ends in the middle of the block"], "before copying its file");
}

/// A SET_FIFO that sets the threshold clears nothing: the targets that wait before it are executed, and drawn so.
#[test]
fn a_threshold_clears_no_targets() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    for i in 1..=40 {
        if i == 21 {
            board.threshold(120);
        }
        board.send(&[250 * i]);
    }
    let cycles: Vec<(f64, i32)> = (0..41)
        .map(|_| {
            board.cycle();
            (board.seconds(), board.targets[0])
        })
        .collect();
    let plot = Recorded::new(&board).plot(&[]);
    // In the middle of each cycle, behind the step to its target.
    for (seconds, target) in &cycles[1..40] {
        near(plot.panel("Axis 1").at(COLOURS[0], true, seconds + 0.0005), (*target).into(), 10_000.0);
    }
}

/// An axis that the network does not have is an error, and the text names the present axes, whether they were moved or
/// not: also in a recording of the native API, whose frames count in all slots.
#[test]
fn an_axis_that_the_network_lacks_is_an_error_with_those_it_has() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("three.pcapng");
    let link = format!("sim:?slaves=drive*3&clock=virtual&record={}", file.display());
    let moved = run(["move", "1=500", "2=30", "--up", "--link", &link]);
    assert_eq!(moved.code, Some(0), "{moved:?}");
    let picture = folder.path().join("three.svg");
    let plot = |axes: &str| {
        let words = [file.as_os_str(), "-o".as_ref(), picture.as_os_str(), "--axes".as_ref(), axes.as_ref()];
        run(["plot".as_ref()].into_iter().chain(words))
    };
    for axes in ["7", "1,4", "40"] {
        plot(axes).expect_failure(1, &["is empty: no slave has its slot in OP"], "name some of 1, 2, 3 with --axes");
        assert!(!picture.exists());
    }
    plot("1-3").expect_quiet();
}

/// An axis without data in the recording is an error, and the text names the axes with data.
#[test]
fn an_axis_without_data_is_an_error_with_those_that_have_some() {
    let (board, _) = two_axes();
    let recorded = Recorded::new(&board);
    recorded.try_plot(&["--axes", "1,9"]).expect_failure(1, &["axis 9 is empty"], "name some of 1, 2 with --axes");
    recorded.plot(&["--axes", "2"]);
}

/// A time on the command line that is no finite number is refused.
#[test]
fn a_time_that_is_no_finite_number_is_refused() {
    let (board, _) = two_axes();
    let recorded = Recorded::new(&board);
    for option in ["--from", "--to"] {
        for none in ["nan", "inf", "-1e999", "NaN", "1e999"] {
            recorded.try_plot(&[option, none]).expect_misuse(&[option, none, "not a time"]);
        }
        recorded.try_plot(&[option, "soon"]).expect_misuse(&[option, "soon", "not a time; write it as in 3.5"]);
    }
}
