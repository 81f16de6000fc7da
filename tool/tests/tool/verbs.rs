//! The verbs that talk to a board, one command line at a time, in virtual time; their output is kept in
//! `tests/snapshots/`.
#![cfg(target_os = "linux")]

use crate::common::board::{BOARD, RecordedTraffic, file, text, transcript};
use crate::common::{json_lines, run};
use ecmsk::sk::{CommandId, MasterState, SlotSize};

fn recorded(name: &str, slaves: &str) -> (String, std::path::PathBuf) {
    let file = file(name);
    (format!("sim:?slaves={slaves}&clock=virtual&record={}", file.display()), file)
}

/// `info` and `state` show the board and its slaves, as text and as JSON; with --scan, `info` reads the identities of the
/// slaves.
#[test]
fn info_and_state_show_board_and_slaves() {
    let step = "sim:?slaves=step,hsp2&clock=virtual&slot=16&fw=1.5";
    support::snapshot(
        "tool_info",
        &transcript(&[
            &["info", "--link", BOARD],
            &["info", "--link", BOARD, "--json"],
            &["info", "--scan", "--link", step],
            &["info", "--scan", "--link", BOARD, "--json"],
            &["info", "--link", BOARD, "--slaves", "drive:csv*2,io"],
            &["state", "--link", BOARD],
            &["state", "op", "--link", BOARD],
            &["state", "safeop", "--link", BOARD, "--cycle-us", "500"],
            &["state", "init", "--link", BOARD],
            &["state", "OP", "--link", BOARD, "--json"],
        ]),
    );
}

/// `info --scan` writes about a network of one slave in the singular.
#[test]
fn a_network_of_one_slave_is_told_in_the_singular() {
    let one = run(["info", "--scan", "--link", "sim:?slaves=drive&clock=virtual"]).expect_quiet();
    assert_eq!(one.lines().last(), Some("found       1 slave"), "{one}");
}

/// `sdo` reads and writes objects by number and by name and shows abort codes in words; `io` reads inputs and sets outputs.
#[test]
fn sdo_and_io_read_and_write() {
    support::snapshot(
        "tool_sdo_io",
        &transcript(&[
            &["sdo", "read", "1", "0x1000", "--link", BOARD],
            &["sdo", "read", "1", "statusword", "--link", BOARD, "--json"],
            &["sdo", "read", "2", "homing_method", "--link", BOARD],
            &["sdo", "read", "1", "0x6098", "--type", "u8", "--link", BOARD],
            &["sdo", "read", "1", "0x1018:4", "--link", BOARD],
            &["sdo", "read", "1", "0x1008", "--link", BOARD],
            &["sdo", "read", "1", "0x60C2:1", "--link", BOARD],
            &["sdo", "read", "1", "supported_modes", "--link", BOARD],
            &["sdo", "write", "1", "home_offset", "-500", "--link", BOARD],
            &["sdo", "write", "1", "0x6098:0", "-1", "--link", BOARD, "--json"],
            &["sdo", "write", "1", "0x6098", "0xFF", "--link", BOARD],
            &["sdo", "read", "1", "0x5555", "--link", BOARD],
            &["sdo", "write", "1", "statusword", "1", "--link", BOARD],
            &["sdo", "read", "1", "0x1000", "--type", "u8", "--link", BOARD],
            &["io", "3", "--link", BOARD, "--up"],
            &["io", "3", "--set", "0x8001", "--link", BOARD, "--up", "--json"],
            &["io", "local", "--link", BOARD],
            &["io", "local", "--set", "63", "--link", BOARD],
        ]),
    );
}

/// With `--up` one command switches axes on, homes or moves them on a network that is not up. Without `--up` nothing is sent,
/// and the error has the command line to type.
#[test]
fn servo_home_and_move_bring_the_network_up_only_with_up() {
    support::snapshot(
        "tool_motion",
        &transcript(&[
            &["servo", "on", "1", "--link", BOARD],
            &["servo", "on", "all", "--link", BOARD, "--up"],
            &["servo", "off", "2", "--link", BOARD, "--up", "--json"],
            &["home", "1", "--link", BOARD],
            &["home", "1", "--link", BOARD, "--up"],
            &["home", "1,2", "--method", "37", "--offset", "-100", "--link", BOARD, "--up", "--json"],
            &["home", "1", "--method", "17", "--speed-switch", "400000", "--link", BOARD, "--up"],
            &["move", "1=1000", "--link", BOARD],
            &["move", "1=1000", "2=-500", "--link", BOARD, "--up"],
            &["move", "1=30000", "--link", BOARD, "--up", "--json"],
            &[
                "move",
                "1=90",
                "2=5",
                "--velocity",
                "20",
                "--counts-per-unit",
                "131072/360,2=10000",
                "--link",
                BOARD,
                "--up",
            ],
            &["move", "2=1.5", "--relative", "--counts-per-unit", "-1000", "--json", "--link", BOARD, "--up"],
            &["move", "1=0", "--link", BOARD, "--up"],
        ]),
    );
}

/// Without `--link` the board is the one that the library would open.
#[test]
fn without_a_link_the_board_is_the_one_of_the_library() {
    let ran = crate::common::ecmsk(["state"]).env("ECMSK_LINK", BOARD).output().expect("it starts");
    assert_eq!(crate::common::Ran::from(ran).expect_quiet(), "PreOP\n");
    let ran = crate::common::ecmsk(["state"]).env("ECMSK_LINK", "nonsense").output().expect("it starts");
    crate::common::Ran::from(ran).expect_failure(1, &["`nonsense` has no scheme"], "ecmsk link help");
    // The test must not use a board that is plugged in here. So libusb, with which the tool would find it, is replaced by a
    // file that cannot be loaded.
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("libusb-1.0.so.0"), "no library").expect("a file");
    let mut nowhere = crate::common::ecmsk(["state"]);
    nowhere.env("HOME", "/nonexistent").env_remove("XDG_CONFIG_HOME").env("LD_LIBRARY_PATH", folder.path());
    let ran = crate::common::Ran::from(nowhere.output().expect("it starts"));
    let words = ["no link was given", "no board at `usb:`", "sudo apt-get install libusb-1.0-0", "sim:?slaves=drive*2"];
    ran.expect_failure(1, &words, "`ecmsk link help`");
}

/// `--up` switches on the axes that a verb names, and no others; a verb without axes switches on none.
#[test]
fn up_switches_on_what_is_named() {
    let (board, file) = recorded("up-move", "drive*3,io");
    run(["move", "2=100", "--up", "--link", &board]);
    let tape = RecordedTraffic::read(&file);
    assert_eq!([1, 2, 3].map(|slave| tape.is_on(slave)), [false, true, false]);
    assert_eq!(tape.state(), Some(MasterState::Op));
    run(["io", "4", "--up", "--link", &board]);
    assert!((1..=3).all(|slave| !RecordedTraffic::read(&file).sent(slave, CommandId::ServoOn)));
    run(["sdo", "read", "1", "0x1000", "--up", "--link", &board]);
    assert_eq!(RecordedTraffic::read(&file).state(), Some(MasterState::PreOp));
}

/// A verb that may not bring the network up sends nothing at all.
#[test]
fn nothing_is_sent_without_up() {
    let (board, file) = recorded("not-up", "drive*2,io");
    for words in [&["move", "1=5"][..], &["home", "1"], &["servo", "on", "1"], &["io", "3", "--set", "1"]] {
        let ran = run(words.iter().copied().chain(["--link", &board]));
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(ran.err.ends_with(" --up\n"), "{}", ran.err);
        assert_eq!(RecordedTraffic::read(&file).written.len(), 0, "{words:?}");
    }
    run(["info", "--link", &board]).expect_quiet();
    assert_eq!(RecordedTraffic::read(&file).written.len(), 0);
}

/// By default the axes stay on; `--close servo-off` switches them off.
#[test]
fn axes_stay_on_unless_close_says_servo_off() {
    let (board, file) = recorded("close", "drive");
    for (how, on) in [(None, true), (Some("hold"), true), (Some("servo-off"), false), (Some("leave"), true)] {
        let close = how.map(|how| ["--close", how]);
        run(["move", "1=2000", "--up", "--link", &board].into_iter().chain(close.into_iter().flatten()));
        let tape = RecordedTraffic::read(&file);
        assert_eq!(tape.is_on(1), on, "{how:?}");
        assert!(tape.last(1).position.abs_diff(2000) <= 1);
    }
}

/// The targets of all axes begin and end in the same frame and are on a straight line, whatever the distances of the axes are.
#[test]
fn axes_move_on_a_straight_line() {
    let (board, file) = recorded("line", "drive*3");
    run(["move", "1=30000", "2=-7777", "3=1", "--up", "--velocity", "50000", "--link", &board]);
    let tape = RecordedTraffic::read(&file);
    let [first, second, third] = [1, 2, 3].map(|slave| tape.targets(slave));
    assert_eq!([first.len(), second.len()], [third.len(); 2]);
    assert_eq!([first.last(), second.last(), third.last()], [Some(&30_000), Some(&-7777), Some(&1)]);
    for (a, b) in first.iter().zip(&second) {
        let on_line = f64::from(*a) * -7777.0 / 30_000.0;
        assert!((f64::from(*b) - on_line).abs() <= 1.0, "{a}, {b}");
    }
    let steps: Vec<i32> = first.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(steps.iter().all(|step| (0..=51).contains(step)), "{steps:?}");
    assert!(steps.contains(&50), "it reaches its speed");
}

/// The targets of a move keep the velocity, acceleration and jerk that the options request.
#[test]
fn a_move_keeps_its_limits() {
    let (board, file) = recorded("limits", "drive");
    let limits = ["--velocity", "100000", "--acceleration", "200000", "--jerk", "1000000"];
    run(["move", "1=150000", "--up", "--link", &board].into_iter().chain(limits));
    let targets = RecordedTraffic::read(&file).targets(1);
    let steps: Vec<i32> = targets.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert_eq!(steps.iter().max(), Some(&100));
    // With the move's acceleration the step changes by at most 0.2 counts a cycle: by 20 counts in 100 cycles, and by two more
    // from rounding.
    let changes: Vec<i32> = steps.windows(101).map(|window| window[100] - window[0]).collect();
    assert!(changes.iter().all(|change| change.abs() <= 22), "{changes:?}");
    assert!(changes.iter().any(|change| *change >= 18), "it uses its acceleration");
    // Each ramp takes 0.7 s: 0.2 s until full acceleration, 0.3 s with it, and 0.2 s until it has ended. So 150,000 counts at
    // 100,000 counts per second take 1.5 s + 0.7 s.
    let seconds = targets.len() as f64 / 1000.0;
    assert!((2.19..=2.21).contains(&seconds), "{seconds}");
    run(["move", "1=150000", "--up", "--link", &board]
        .into_iter()
        .chain(limits[..4].iter().copied())
        .chain(["--jerk", "off"]));
    let seconds = RecordedTraffic::read(&file).targets(1).len() as f64 / 1000.0;
    assert!((1.99..=2.01).contains(&seconds), "{seconds}");
}

/// An HSP moves its first channel, the second one stays where it is.
#[test]
fn the_second_channel_of_an_hsp_stays() {
    let file = file("hsp2");
    let board = format!("sim:?slaves=hsp2:start@5000&slot=16&clock=virtual&record={}", file.display());
    let ran = run(["move", "1=6000", "--up", "--link", &board]);
    assert_eq!(ran.out, "axis 1: at 6000\n", "{ran:?}");
    let tape = RecordedTraffic::of_size(&file, SlotSize::Bytes16);
    let last =
        ecmsk::sk::HspResponse::decode(&tape.reports.last().unwrap().slot(SlotSize::Bytes16, 1), SlotSize::Bytes16);
    assert_eq!((last.first.position, last.second.position), (6000, 5000));
}

/// An alarm on the way ends the move: the other axis comes to a standstill, and the error says what to do.
#[test]
fn an_alarm_during_a_move_stops_the_other_axis() {
    let events = text("alarm.ecmscript", "at 1200ms alarm 2 0x7500\n");
    // The axis with the alarm is the second one of the move, or the first one.
    for targets in [["1=100000", "2=100000"], ["2=100000", "1=100000"]] {
        let (board, file) = recorded("alarm", "drive*2");
        let board = format!("{board}&script={events}");
        let ran = run(["move", targets[0], targets[1], "--velocity", "50000", "--up", "--link", &board]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(1), ""), "{ran:?}");
        assert!(ran.err.contains("error: axis 2 has alarm 0x7500: communication; remove the cause"), "{}", ran.err);
        assert!(ran.err.contains("ecmsk servo clear 2") && ran.err.contains("note: axis 1 is at "), "{}", ran.err);
        let tape = RecordedTraffic::read(&file);
        expect_axis_1_was_braked(&tape);
        assert!(!tape.is_on(2));
    }
}

/// An axis that its drive does not let follow ends the move in the same way: its target runs further ahead than the
/// lead limit.
#[test]
fn an_axis_that_does_not_follow_stops_the_other_one_on_its_ramp() {
    // The targets in the FIFO are 3200 counts ahead.
    let (board, file) = recorded("too-far", "drive,drive:limits@-20000..20000");
    let how = ["--velocity", "50000", "--lead-limit", "5000", "--up", "--link", &board];
    let ran = run(["move", "1=100000", "2=100000"].into_iter().chain(how));
    assert_eq!((ran.code, ran.out.as_str()), (Some(1), ""), "{ran:?}");
    assert!(
        ran.err.contains("error: axis 2 does not follow: it is at ") && ran.err.contains("the limit is 5000"),
        "{}",
        ran.err
    );
    let tape = RecordedTraffic::read(&file);
    expect_axis_1_was_braked(&tape);
    let (held, at) = (*tape.targets(2).last().unwrap(), *tape.positions(2).last().unwrap());
    assert!(held.abs_diff(at) <= 64, "it holds where it is: target {held}, at {at}");
}

/// The other axis comes to rest where its targets end, and these brake it: its step changes by two counts at most in a
/// cycle, of 50 at full speed.
#[track_caller]
fn expect_axis_1_was_braked(tape: &RecordedTraffic) {
    let targets = tape.targets(1);
    let steps: Vec<i32> = targets.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let changes = steps.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    assert!(steps.contains(&50) && steps.last().unwrap().abs() <= 1, "it was fast, and came to rest: {steps:?}");
    assert!(changes.max().unwrap() <= 2, "it was braked: {steps:?}");
    let positions = tape.positions(1);
    let rest = &positions[positions.len() - 2..];
    let last = *targets.last().expect("it moved");
    assert!(rest[0].abs_diff(rest[1]) <= 2 && rest[1].abs_diff(last) <= 10 && last < 100_000, "{rest:?}, told {last}");
    assert!(tape.is_on(1));
}

/// Progress is printed once a second after the first second, on standard error; as JSON on standard output.
#[test]
fn progress_is_told_once_a_second() {
    let line = ["move", "1=35000", "--up", "--link", BOARD];
    let ran = run(line);
    let told = ran.err.lines().filter(|line| line.starts_with("progress: moving")).count();
    assert_eq!((told, ran.out.as_str()), (3, "axis 1: at 35000\n"), "{}", ran.err);
    let ran = run(line.into_iter().chain(["--json"]));
    let objects = json_lines(&ran.out);
    assert_eq!(objects.len(), 4);
    assert!(objects[..3].iter().all(|object| object["verb"] == "move" && object["progress"].is_f64()));
    assert_eq!(objects[3]["position_counts"], 35_000);
    assert!(!ran.err.contains("progress"), "{}", ran.err);
}

/// However hard a move brakes, it ends at its target, and no command goes beyond it.
#[test]
fn a_hard_move_ends_at_its_target() {
    for (velocity, acceleration, jerk) in
        [("50000", "1e8", "off"), ("100000", "1e12", "off"), ("100000", "1e12", "1e15"), ("20000", "1e5", "off")]
    {
        let (board, file) = recorded("hard", "drive*2");
        let how = ["--velocity", velocity, "--acceleration", acceleration, "--jerk", jerk, "--up", "--link", &board];
        let ran = run(["move", "1=30000", "2=-15000"].into_iter().chain(how));
        assert_eq!(ran.code, Some(0), "{ran:?}");
        for (slave, end) in [(1, 30_000), (2, -15_000_i32)] {
            let targets = RecordedTraffic::read(&file).targets(slave);
            let furthest = targets.iter().map(|target| target * end.signum()).max();
            assert_eq!((furthest, targets.last()), (Some(end.abs()), Some(&end)), "{velocity} {acceleration} {jerk}");
        }
    }
}
