//! `move`: moves that are refused before they begin, their duration, and a drive that holds an axis back.

use std::path::PathBuf;

use crate::common::board::{BOARD, RecordedTraffic, file, text};
use crate::common::{Ran, run, run_with_input};

fn recorded(name: &str, slaves: &str) -> (String, PathBuf) {
    let file = file(name);
    let _ = std::fs::remove_file(&file);
    (format!("sim:?slaves={slaves}&clock=virtual&record={}", file.display()), file)
}

/// The error, which is the last line of standard error.
fn error(ran: &Ran) -> &str {
    ran.err.lines().last().and_then(|line| line.strip_prefix("error: ")).unwrap_or_else(|| panic!("{ran:?}"))
}

/// TOOL-20 `--guard N` refuses a target further than N counts from where an axis is, before any axis moves, and says which
/// axis, how far, and what to do.
#[test]
fn the_guard_refuses_a_target_that_is_too_far() {
    let (board, tape) = recorded("guard", "drive:start@5000*2");
    let moved = |words: &[&str]| run(words.iter().copied().chain(["--up", "--link", &board]));
    for (words, why) in [
        (
            &["move", "1=200000", "--guard", "1000"] as &[_],
            "axis 1 is at 5000, and 200000 is 195000 counts away; --guard allows 1000 counts; ",
        ),
        (&["move", "2=-5001", "1=5010", "--guard", "10000"], "axis 2 is at 5000, and -5001 is 10001 counts away; "),
        (&["move", "1=1001", "--relative", "--guard", "1000"], "axis 1 is at 5000, and 6001 is 1001 counts away; "),
        (
            &["move", "1=-2147483648", "--guard", "2147483647"],
            "axis 1 is at 5000, and -2147483648 is 2147488648 counts away; ",
        ),
    ] {
        let ran = moved(words);
        assert_eq!((ran.code, ran.out.as_str()), (Some(1), ""), "{ran:?}");
        assert!(error(&ran).starts_with("move: ") && error(&ran).contains(why), "{}", ran.err);
        assert!(error(&ran).ends_with("; name a nearer target, or widen --guard"), "{}", ran.err);
        let tape = RecordedTraffic::read(&tape);
        assert!([1, 2].map(|slave| tape.targets(slave)).concat().iter().all(|target| *target == 5000), "{words:?}");
        assert!(tape.positions(1).iter().chain(&tape.positions(2)).all(|at| at.abs_diff(5000) <= 5 || *at == 0));
    }
    for (words, at) in [
        (&["move", "1=6000", "--guard", "1000"] as &[_], "axis 1: at 6000\n"),
        (&["move", "1=-1000", "--relative", "--guard", "1000"], "axis 1: at 4000\n"),
        (&["move", "1=20000", "--guard", "off"], "axis 1: at 20000\n"),
    ] {
        assert_eq!(moved(words).out, at);
    }
    // The move goes further than the default of `--lead-limit`. That limits how far the target of a cycle is ahead of the axis,
    // and not how far a move goes.
    assert_eq!(moved(&["move", "1=200000", "--velocity", "400000"]).code, Some(0));
}

/// TOOL-20 In a script the guard holds for each move, from the end of the last one.
#[test]
fn the_guard_holds_for_each_move_of_a_script() {
    let lines = "state op\nservo on 1\nmove 1=900\nmove 1=1800\nmove 1=1000 --relative\nmove 1=4000\n";
    let ran = run_with_input(&["run", "-", "--guard", "1000", "--link", BOARD], lines);
    assert_eq!((ran.code, ran.out.lines().last()), (Some(1), Some("axis 1: at 2800")), "{ran:?}");
    let lines = "state op\nservo on 1\nmove 1=900\nmove 1=1901\n";
    let ran = run_with_input(&["run", "-", "--guard", "1000", "--link", BOARD], lines);
    assert!(error(&ran).contains(":4: move: axis 1 is at 900, and 1901 is 1001 counts away"), "{}", ran.err);
}

/// A move that takes more than a minute says so before its first progress; without a terminal it goes on, with
/// and without `--yes`, and shorter ones say nothing.
#[test]
fn a_long_move_says_its_time_first() {
    // With a cycle time of 4 ms the simulation of these long moves has few cycles.
    let options = ["--velocity", "100", "--up", "--cycle-us", "4000", "--link", BOARD];
    let moved = |words: &[&'static str]| run(words.iter().chain(&options));
    let ran = moved(&["move", "1=50000"]);
    let told: Vec<&str> = ran.err.lines().filter(|line| !line.starts_with("note: configured")).collect();
    assert_eq!(told[1], "note: this move takes 8 min 21 s, for 50000 counts; --velocity makes it shorter");
    assert!(told[2].starts_with("progress: ") && ran.out == "axis 1: at 50000\n", "{ran:?}");
    let ran = moved(&["move", "1=7000", "--yes"]);
    assert!(ran.code == Some(0) && ran.err.contains("note: this move takes 1 min 10 s, "), "{ran:?}");
    let ran = moved(&["move", "1=5900"]);
    assert!(ran.code == Some(0) && !ran.err.contains("takes"), "{}", ran.err);
    let lines = "state op\nservo on 1\nmove 1=7000 --velocity 100 --yes\n";
    let ran = run_with_input(&["run", "-", "--cycle-us", "4000", "--link", BOARD], lines);
    assert!(ran.code == Some(0) && ran.err.contains("note: this move takes 1 min 10 s, "), "{ran:?}");
}

/// Units that are given axis by axis must cover each axis of a move: an axis that would move in counts unasked is
/// refused before anything is sent, and so is a unit for an axis that a single move does not name.
#[test]
fn units_are_for_the_axes_of_the_move() {
    let moved = |words: &[&str]| run(words.iter().copied().chain(["--up", "--link", BOARD]));
    for (words, why, next) in [
        (
            &["move", "1=50", "--counts-per-unit", "2=100"] as &[_],
            "--counts-per-unit says nothing of axis 1, which would move in counts",
            "add its counts per unit, or 1=1 if its target is in counts",
        ),
        (
            &["move", "1=50", "2=30", "--counts-per-unit", "2=100"],
            "--counts-per-unit says nothing of axis 1",
            "or 1=1 if its target is in counts",
        ),
        (
            &["move", "1=50", "--counts-per-unit", "1=100,2=100"],
            "--counts-per-unit names axis 2, the move axis 1",
            "or one number for all: --counts-per-unit N",
        ),
        (
            &["move", "1=50", "--counts-per-unit", "100,2=5"],
            "--counts-per-unit names axis 2, the move axis 1",
            "or one number for all: --counts-per-unit N",
        ),
    ] {
        moved(words).expect_failure(1, &[why], next);
    }
    assert_eq!(
        moved(&["move", "1=5", "2=30", "--counts-per-unit", "1=100,2=1"]).out,
        "axis 1: at 5 (500 counts)\naxis 2: at 30\n"
    );
    assert_eq!(moved(&["move", "1=5", "--counts-per-unit", "100"]).out, "axis 1: at 5 (500 counts)\n");
    // In a script `--counts-per-unit` is for all axes of the machine: it may name one that a single move does not have.
    let in_script = |lines| run_with_input(&["run", "-", "--counts-per-unit", "1=100", "--up", "--link", BOARD], lines);
    assert_eq!(in_script("move 1=5\n").out, "axis 1: at 5 (500 counts)\n");
    let ran = in_script("move 1=5\nmove 1=6 2=7\n");
    assert!(ran.code == Some(1) && ran.out.is_empty(), "{ran:?}");
    assert!(error(&ran).contains(":2: move: --counts-per-unit says nothing of axis 2"), "{}", ran.err);
    let ran = run_with_input(&["run", "-", "--counts-per-unit", "1=100,2=5", "--up", "--link", BOARD], "move 1=5\n");
    assert_eq!(ran.out, "axis 1: at 5 (500 counts)\n", "{ran:?}");
}

/// An axis that its drive holds back ends the move: the others are braked, the error says that an internal limit is
/// active, and the axis comes back.
#[test]
fn a_drive_that_holds_an_axis_back_ends_the_move() {
    for scheme in ["sim", "xf-sim"] {
        for kind in ["drive", "step", "hsp", "dp3cl"] {
            let board = format!("{scheme}:?slaves={kind}:limits@-1000..1000,drive&clock=virtual");
            let ran = run(["move", "1=5000", "2=50000", "--velocity", "20000", "--up", "--link", &board]);
            let what = format!("{board}: {ran:?}");
            assert_eq!((ran.code, ran.out.as_str()), (Some(1), ""), "{what}");
            let (before, after) = error(&ran).split_once(" stands at ").expect(&what);
            let (at, why) = after.split_once(": ").expect(&what);
            assert_eq!(before, "move: axis 1", "{what}");
            assert!((1000..1100).contains(&at.parse::<i32>().expect(&what)), "{what}");
            assert!(
                why.starts_with("its drive holds it back (internal limit active, statusword bit 11); see "),
                "{what}"
            );
            let pushed = ran.err.lines().find_map(|line| line.strip_prefix("note: axis 1 pushed, ")).expect(&what);
            assert!(pushed.contains(" from its target: its target is now its actual position, 1"), "{what}");
            let second = ran.err.lines().find_map(|line| line.strip_prefix("note: axis 2 is at ")).expect(&what);
            assert!((5000..40_000).contains(&second.parse::<i32>().expect(&what)), "{what}");
        }
    }
    // The move ends before the internal limit has lasted long enough to be noticed. Then the error is that the axis has not
    // arrived, and why.
    let board = "sim:?slaves=drive:limits@-1000..1000&clock=virtual";
    let ran = run(["move", "1=1200", "--up", "--link", board]);
    let ending = "off its target: its drive holds it back (internal limit active, statusword bit 11)";
    assert!(ran.code == Some(1) && error(&ran).contains(ending), "{ran:?}");
    let lines = "state op\nservo on 1\nmove 1=5000\nmove 1=-200\nmove 1=-900\n";
    let ran = run_with_input(&["shell", "--keep-going", "--link", board], lines);
    assert!(ran.out.ends_with("axis 1: at -200\naxis 1: at -900\n") && ran.code == Some(1), "{ran:?}");
}

/// A slave that is lost during a move ends it: the other axis is braked on its path, and the error names the slave and
/// says what to do.
#[test]
fn a_slave_that_is_lost_ends_the_move() {
    let events = text("lost.ecmscript", "at 2s lose 2\n");
    let board = format!("sim:?slaves=drive*2&clock=virtual&script={events}");
    let ran = run(["move", "1=90000", "2=90000", "--velocity", "20000", "--yes", "--up", "--link", &board]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(1), ""), "{ran:?}");
    assert!(error(&ran).contains("slave 2 is lost, the board is in "), "{ran:?}");
    assert!(error(&ran).ends_with("check cable and power, then set_state brings it back"), "{ran:?}");
    let first = ran.err.lines().find_map(|line| line.strip_prefix("note: axis 1 is at ")).expect("its position");
    assert!((1..89_000).contains(&first.parse::<i32>().expect("counts")), "{ran:?}");
}
