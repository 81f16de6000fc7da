//! The bad moments of a long run: `ecmsk summary` with its page, and `ecmsk find`.

use std::sync::OnceLock;

use ecmsk::ecm::{Axis, Close, Config, Ecm, Slave};
use ecmsk::sk::MasterState;

use crate::common::board::{file, text};
use crate::common::{json_lines, run};

/// How long the run moves, in cycles of 1 ms.
const CYCLES: i32 = 30_000;
/// The cycle of the motion in which the target of axis 1 steps by 3,000 counts more than before.
const STEP: i32 = 20_000;
/// When a script blocks axis 2 for 20 ms, in seconds since the board was opened.
const JAM: f64 = 10.0;
/// How much a time may be off, in seconds.
const NEAR: f64 = 0.005;

/// A run of the night in virtual time, recorded in blocks: its path.
fn night() -> &'static str {
    static PATH: OnceLock<String> = OnceLock::new();
    PATH.get_or_init(|| {
        let script = text("night.script", &format!("at {JAM}s jam 2 for 20ms\n"));
        let path = file("night.ecmrec");
        let _ = std::fs::remove_file(&path);
        let path = path.display().to_string();
        let link = format!("sim:?slaves=drive*2&clock=virtual&script={script}&record={path}");
        let ecm = Ecm::open(&link).expect("a board");
        ecm.configure(&Config { slaves: vec![Slave::Drive(Axis::CSP); 2], ..Config::default() }).expect("configured");
        ecm.set_state(MasterState::Op).expect("OP");
        ecm.servo_on(&[1, 2]).expect("they are on");
        let mut stream = ecm.stream(8).expect("a stream");
        // Both axes go to and fro, so that their positions stay small.
        let mut target = [0; 2];
        for cycle in 0..CYCLES {
            let step = if cycle / 1000 % 2 == 0 { 10 } else { -10 };
            target[0] += if cycle == STEP { 3_000 + step } else { step };
            target[1] += step;
            let sent = stream.csp(1, target[0]).and_then(|()| stream.csp(2, target[1]));
            sent.and_then(|()| stream.step().map(drop)).expect("it is sent");
        }
        stream.finish().expect("it stands");
        ecm.close(Close::ServoOff).expect("it is closed");
        path
    })
}

/// The times at which the expression becomes true in the run of the night.
fn found(expression: &str) -> Vec<f64> {
    let ran = run(["find", expression, night(), "--json"]);
    assert!(ran.err.is_empty() && matches!(ran.code, Some(0 | 1)), "{ran:?}");
    json_lines(&ran.out).iter().map(|found| found["at_s"].as_f64().expect("a time")).collect()
}

/// When axis 1 steps, in seconds: it moves then as fast as at no other time.
fn stepped() -> f64 {
    let ran = run(["find", "velocity(1) > 100000", night(), "--json"]);
    json_lines(&ran.out)[0]["at_s"].as_f64().expect("a time")
}

/// `summary` and `find` name the axes and the times of a jam of 20 ms and of a step of 3,000 counts in a long run, and the page
/// has both with pictures.
#[test]
fn a_jam_and_a_step_of_the_night_are_found() {
    let page = file("night.html");
    let page_name = page.display().to_string();
    let json = run(["summary", "--json", "--html", &page_name, night()]).json();
    let peak = |axis: usize, quantity: &str| {
        let peak = &json["axes"][axis - 1][quantity];
        (peak["value"].as_f64().expect("a value"), peak["at_s"].as_f64().expect("a time"))
    };
    let (step, stepped_at) = peak(1, "target_step");
    assert!(step == 3_010.0 || step == 2_990.0, "{json}");
    assert!((stepped_at - stepped()).abs() < NEAR, "{json}");
    let (_, jammed_at) = peak(2, "following_error");
    assert!((jammed_at - JAM - 0.020).abs() < NEAR, "{json}");

    let steps = found("target_step(1) > 2000");
    assert!(steps.len() == 1 && (steps[0] - stepped_at).abs() < NEAR, "{steps:?}");
    // The axis falls behind by 10 counts a millisecond from the jam on.
    let jams = found("following_error(2) > 40");
    assert!(jams.len() == 1 && (jams[0] - JAM).abs() < NEAR, "{jams:?}");
    assert!(found("target_step(2) > 2000 or following_error(2) > 1000").is_empty());

    let html = std::fs::read_to_string(page).expect("a page");
    for (axis, what, at) in [(1, "target step", stepped_at), (2, "following error", jammed_at)] {
        let heading = html
            .lines()
            .find(|line| line.starts_with("<h3>") && line.contains(&format!("axis {axis}: largest {what} ")));
        let heading = heading.unwrap_or_else(|| panic!("axis {axis}"));
        assert!(heading.contains(&format!("at {at:.3} s")), "{heading}");
    }
    let pictures = html.split("<svg ").count() - 1;
    assert!((2..=4).contains(&pictures), "{pictures}");
    for text in ["<script", "<link", "@import", "url("] {
        assert!(!html.contains(text), "{text}");
    }
}

/// With `--from`, `--to` and `--around` only that part counts, for the limits, too.
#[test]
fn a_summary_is_of_a_part_of_the_run() {
    let step = found("target_step(1) > 2000")[0];
    let with = |options: &[&str]| run([&["summary", "--fail-on", "target-step>2000"], options, &[night()]].concat());
    assert_eq!(with(&[]).code, Some(1));
    assert_eq!(with(&["--around", &step.to_string()]).code, Some(1));
    assert_eq!(with(&["--from", &(step + 0.001).to_string()]).code, Some(0));
    let before = with(&["--to", &(step - 0.001).to_string()]);
    assert_eq!(before.code, Some(0));
    assert!(before.out.contains("target step up to 10 counts"), "{before:?}");
    let none = with(&["--from", "9999"]);
    assert!(none.err.contains("frames is left; change --from, --to or --around"), "{none:?}");
    with(&["--around", "1", "--to", "2"]).expect_misuse(&["--around", "--to"]);
}

/// `find` prints each time with its duration as `dump` and `plot` take it, and has the exit codes of grep.
#[test]
fn times_that_are_found_are_those_of_dump_and_plot() {
    let ran = run(["find", "following_error(2) > 100", night()]);
    assert_eq!((ran.code, ran.out.lines().count()), (Some(0), 1), "{ran:?}");
    let mut words = ran.out.split_whitespace();
    let at = words.next().expect("a time");
    let frames = run(["dump", night(), "--around", at, "--direction", "response", "--slots", "2"]).expect_quiet();
    assert!(frames.contains(&format!(" {at} s  response")), "{frames}");
    assert!(frames.lines().filter(|line| line.starts_with("frame")).count() > 190, "{frames}");
    let picture = file("night.svg").display().to_string();
    run(["plot", night(), "--around", at, "-o", &picture]).expect_quiet();
    assert_eq!(run(["find", "fault", night()]).code, Some(1));
    run(["find", "following_error(2", night()]).expect_failure(2, &["column 18 of the expression"], "find --help`");
    run(["find", "fault", "no such file"]).expect_failure(2, &["no such file"], "check the path");
    run(["find", "fault"]).expect_misuse(&["<FILE>"]);
}

/// `--junit` writes a test case for each reason, with the reasons of those that failed.
#[test]
fn reasons_are_test_cases() {
    let xml = file("night.xml");
    let name = xml.display().to_string();
    let ran = run(["summary", "--fail-on", "alarm,target-step>2000", "--junit", &name, night()]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let xml = std::fs::read_to_string(xml).expect("a file");
    assert!(xml.contains("tests=\"2\" failures=\"1\""), "{xml}");
    assert!(xml.contains("name=\"alarm\" time=\"0.000\"/>"), "{xml}");
    assert!(xml.contains("name=\"target-step&gt;2000\""), "{xml}");
    assert!(xml.contains("<failure message=\"axis 1: target step "), "{xml}");
    run(["summary", "--junit", night(), night()]).expect_failure(1, &["is the recording"], "another file with --junit");
}

/// A page, results and a picture of the night before are replaced, as a test of each night needs it. A machine file and a
/// recording stay, and that is said before the recording is read.
#[test]
fn files_of_another_kind_stay() {
    let copy = file("night copy.ecmrec");
    std::fs::copy(night(), &copy).expect("a copy");
    let machine = text("night machine.toml", "format = 1\n[axes]\nX = { slave = 1 }\n");
    let svg = file("night machine.svg");
    std::fs::write(&svg, "format = 1\n").expect("a file");
    let (copy, svg) = (copy.display().to_string(), svg.display().to_string());
    for (verb, option, other) in [
        ("summary", "--html", &machine),
        ("summary", "--junit", &machine),
        ("summary", "--html", &copy),
        ("summary", "--junit", &copy),
        ("plot", "-o", &svg),
    ] {
        let before = std::fs::read(other).expect("a file");
        let ran = run([verb, night(), option, other]);
        ran.expect_failure(1, &[other, "is there already and is no ", option], "or replace it with --overwrite");
        assert!(ran.out.is_empty() && std::fs::read(other).expect("a file") == before, "{option}");
        run([verb, night(), option, other, "--overwrite"]).expect_quiet();
        run([verb, night(), option, other]).expect_quiet();
        std::fs::write(other, before).expect("a file");
    }
}
