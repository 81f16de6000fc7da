//! `ecmsk run` and `ecmsk shell`: the same steps on one open board, in virtual time.
#![cfg(target_os = "linux")]

use crate::common::board::{BOARD, RecordedTraffic, file, script, text, transcript_entry};
use crate::common::{Ran, ecmsk, run, run_with_input};

const DAY: &str = "\
# From nothing to a path and back.
state op
servo on 1,2
home all                               # as the drives are set
move 1=10000 2=-5000 --velocity 20000

wait 250ms
move 1=-2000 --relative
io 3 --set 0x1
io 3
sdo write 1 following_error_window 4000
sdo read 1 following_error_window
expect position 1=8000 2=-5000 --within 2
expect inputs 3=0x1
expect state op
info
servo off all
state preop
";

/// A script does its steps in order; as JSON each object has the number of its line.
#[test]
fn a_script_does_its_steps_in_order() {
    let file = text("day.ecm", DAY);
    let words = ["run", "day.ecm", "--link", BOARD];
    let mut all = transcript_entry(&words, &run(["run", &file, "--link", BOARD]));
    let words = ["run", "-", "--json", "--link", BOARD];
    all += &transcript_entry(&words, &run_with_input(&words, DAY));
    support::snapshot("tool_run", &all);
}

/// Every wrong line is reported, with file, line and what is allowed, and nothing at all is sent.
#[test]
fn every_wrong_line_is_told_and_nothing_is_sent() {
    let wrong = "\
stat op
state op preop
servo on
servo maybe 1
home 7
home 3
move 1=x
move 3=100
move 1=5 1=6
move 1=5 --velocity 0
move 1=99999999999
move 1=5 --velocity 5000000
state op                                # this one is right

sdo
sdo read 1 statuswrod
sdo write 1 0x2000 5
sdo write 1 mode 300
sdo read 41 mode
io 1
io local --set 64
wait forever
wait 0s
expect position 1=5 --within -1
expect inputs 1=0x1
quit
";
    let file = file("wrong");
    let board = format!("{BOARD}&record={}", file.display());
    let ran = script(&board, wrong);
    assert!(!file.exists(), "the board was not even opened");
    assert_eq!(ran.err.lines().count(), 24, "{}", ran.err);
    support::snapshot("tool_run_wrong", &transcript_entry(&["run", "-", "--link", BOARD], &ran));
}

/// The first step that fails ends the script: it is reported with its line, and earlier steps stay in effect.
#[test]
fn a_step_that_fails_ends_a_script() {
    let file = file("fails");
    let board = format!("{BOARD}&record={}", file.display());
    let ran = script(&board, "state op\nservo on 1\n\nmove 2=100\nmove 1=100\n");
    assert_eq!(ran.code, Some(1));
    let error = "error: standard input:4: move needs axis 2 on, it is in Switch on disabled (0x0250); write `servo on 2` before it";
    assert_eq!(ran.err.lines().last(), Some(error));
    let tape = RecordedTraffic::read(&file);
    assert!(tape.is_on(1) && tape.targets(1).is_empty());
    for (lines, why) in [
        ("move 1=5", ":1: move needs OP, the network is in PreOP; write `state op` before it"),
        ("state op\nexpect position 1=5", ":2: expect: axis 1 is at 0, not at 5 within 0; see what came before"),
        ("expect state op", ":1: expect: the network is in PreOP, not in OP; see what came before"),
        ("state op\nexpect inputs 3=1", ":2: expect: inputs of slave 3 are 0x0000, not 0x0001; see what came before"),
        ("sdo read 1 0x5555", ":1: reading 0x5555:0 of slave 1 was aborted with 0x06020000"),
    ] {
        let ran = script(BOARD, lines);
        assert_eq!(ran.code, Some(1));
        assert!(ran.err.contains(why), "{}", ran.err);
    }
}

/// A script that cannot be read is reported.
#[test]
fn a_script_that_cannot_be_read_is_an_error() {
    run(["run", "/no/such/script", "--link", BOARD]).expect_failure(
        1,
        &["/no/such/script", "No such file"],
        "name a file",
    );
    let latin = file("latin");
    std::fs::write(&latin, b"state op # \xE4\n").unwrap();
    run(["run", latin.to_str().unwrap(), "--link", BOARD]).expect_failure(1, &["not UTF-8"], "name a text file");
    let long = text("long.ecm", &"#".repeat((1 << 20) + 1));
    run(["run", &long, "--link", BOARD]).expect_failure(1, &["longer than 1048576 bytes"], "cut it into several");
    run(["run", "--link", BOARD]).expect_misuse(&["<SCRIPT>"]);
}

/// Moves of one session follow each other without drift: each begins at the target of the last one.
#[test]
fn relative_moves_do_not_drift() {
    let file = file("drift");
    let board = format!("{BOARD}&record={}", file.display());
    // After the fast move the axis is a few counts off its target.
    let steps = "move 1=1 --relative\n".repeat(40);
    let lines = format!("state op\nservo on 1\nmove 1=50000 --velocity 1000000\n{steps}");
    let ran = script(&board, &lines);
    assert_eq!(ran.code, Some(0));
    assert_ne!(ran.out.lines().nth(2), Some("axis 1: at 50000"), "{}", ran.out);
    assert_eq!(RecordedTraffic::read(&file).targets(1).last(), Some(&50_040));
}

/// TOOL-20 Targets may be in units. A relative target that leads beyond 32 bits is refused before a frame of the move is sent.
#[test]
fn targets_are_in_units_and_stay_within_32_bits() {
    let board = "sim:?slaves=drive:start@2147483000&clock=virtual";
    let file = file("edge");
    let recorded = format!("{board}&record={}", file.display());
    let ran = script(&recorded, "state op\nservo on 1\nmove 1=647 --relative\nmove 1=1 --relative\n");
    assert_eq!((ran.code, ran.out.lines().last()), (Some(1), Some("axis 1: at 2147483647")));
    assert!(ran.err.contains(":4: move: target 1 of axis 1 is outside the 32 bits"), "{}", ran.err);
    assert_eq!(RecordedTraffic::read(&file).targets(1).last(), Some(&i32::MAX));
    let words = ["run", "-", "--counts-per-unit", "1=1000", "--link", BOARD];
    let ran =
        run_with_input(&words, "state op\nservo on 1\nmove 1=2.5\nexpect position 1=2.5\nexpect position 1=2500\n");
    assert!(ran.out.ends_with("axis 1: at 2.5 (2500 counts)\n"), "{ran:?}");
    assert!(ran.err.contains(":5: expect: axis 1 is at 2.5, not at 2500"), "{}", ran.err);
}

/// TOOL-20 A speed at which targets would be too far ahead of the axis is refused at once, and `--lead-limit` allows it.
#[test]
fn a_speed_that_the_lead_limit_would_refuse_is_refused_at_once() {
    let line = ["move", "1=50000", "--velocity", "1000000", "--up", "--link", BOARD];
    let limited = run(line.into_iter().chain(["--lead-limit", "1000"]));
    limited.expect_failure(
        1,
        &["runs 64000 counts ahead of it, the limit is 1000"],
        "lower --velocity, or widen --lead-limit",
    );
    for passes in [run(line), run(line.into_iter().chain(["--lead-limit", "off"]))] {
        let at: i32 = passes.out.trim().trim_start_matches("axis 1: at ").parse().expect("a position");
        assert!(passes.code == Some(0) && at.abs_diff(50_000) <= 2, "it has settled: {passes:?}");
    }
    for option in ["--guard", "--lead-limit"] {
        run(line.into_iter().chain([option, "0"])).expect_misuse(&["counts, 1 or more, or off"]);
    }
}

fn shell(lines: &str) -> Ran {
    run_with_input(&["shell", "--link", BOARD], lines)
}

/// Without a terminal the first line that fails ends the shell: it is reported with its number, no later line is run,
/// and the exit code is 1.
#[test]
fn a_shell_without_a_terminal_ends_at_an_error() {
    for (lines, error) in [
        ("state op\n# nothing\n\nfoo\nservo on 1\n", "error: standard input:4: `foo` is unknown; allowed: info, "),
        ("state op\nmove 1=5\nservo on 1\n", "error: standard input:2: move needs axis 1 on, it is in "),
        ("state op\nhelp foo\nservo on 1", "error: standard input:2: `foo` is unknown; "),
    ] {
        let ran = shell(lines);
        assert_eq!((ran.code, ran.out.as_str()), (Some(1), "OP\n"), "{ran:?}");
        let errors: Vec<&str> = ran.err.lines().filter(|line| !line.starts_with("note: ")).collect();
        assert!(errors.len() == 1 && errors[0].starts_with(error), "{}", ran.err);
    }
}

/// The shell reads lines without a terminal, too, and prints only results; with `--keep-going` errors do not end it,
/// each is reported with its line, and the exit code says whether there were any.
#[test]
fn a_shell_without_a_terminal_prints_results_only() {
    let lines =
        "state\nstate op\nfoo\nmove 1=5\nservo on 1\n# nothing\n\nmove 1=5\nhelp servo\nhelp foo\nstate\nquit\nstate\n";
    let words = ["shell", "--keep-going", "--link", BOARD];
    support::snapshot("tool_shell", &transcript_entry(&words, &run_with_input(&words, lines)));
    assert_eq!(shell("state op").quiet_but_for_notes(), "OP\n");
    assert_eq!(shell("").expect_quiet(), "");
    let help = shell("help").expect_quiet();
    for word in ["info", "state", "sdo", "io", "servo", "home", "move", "wait", "expect", "quit", "help"] {
        assert!(help.contains(word), "{word} is missing in {help}");
    }
    let ran = Ran::from(ecmsk(["shell", "--link", BOARD]).stdin(std::fs::File::open("/").unwrap()).output().unwrap());
    ran.expect_failure(1, &["standard input"], "lines of text");
}

trait ButForNotes {
    fn quiet_but_for_notes(self) -> String;
}

impl ButForNotes for Ran {
    fn quiet_but_for_notes(self) -> String {
        assert!(self.code == Some(0) && self.err.lines().all(|line| line.starts_with("note: ")), "{self:?}");
        self.out
    }
}
