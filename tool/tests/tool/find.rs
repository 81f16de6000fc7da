//! `ecmsk find`: what may stand in an expression, and when it is true.

use crate::common::board::{file, text};
use crate::common::motion::{FakeBoard, go};
use crate::common::plots::{Recorded, spans_are};
use crate::common::{Ran, json_lines, run};
use ecmsk::sk::SlotSize;

fn find(recorded: &Recorded, expression: &str, options: &[&str]) -> Ran {
    run([&["find", expression, recorded.file.to_str().expect("UTF-8")], options].concat())
}

/// From when to when the expression is true, in seconds; the end of the last one only if the recording shows it.
fn spans(recorded: &Recorded, expression: &str) -> Vec<(f64, Option<f64>)> {
    let ran = find(recorded, expression, &["--json"]);
    assert!(matches!(ran.code, Some(0 | 1)), "{ran:?}");
    let seconds = |value: &serde_json::Value| value.as_f64().expect("a number");
    let span = |found: &serde_json::Value| {
        let (at, lasts) = (seconds(&found["at_s"]), seconds(&found["duration_s"]));
        (at, found["ended"].as_bool().expect("true or false").then_some(at + lasts))
    };
    json_lines(&ran.out).iter().map(span).collect()
}

#[track_caller]
fn near(found: &[(f64, Option<f64>)], expected: &[(f64, f64)]) {
    // What has no end in the recording is near nothing.
    let ended: Vec<_> = found.iter().map(|(from, to)| (*from, to.unwrap_or(f64::NAN))).collect();
    spans_are(&ended, expected, 0.0035);
}

/// A slave that is lost in state 0x18 is found, and the state itself.
#[test]
fn a_lost_slave_is_found() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 2);
    go(&mut board, 0..300);
    board.lost = vec![2];
    go(&mut board, 300..301);
    let from = board.seconds();
    go(&mut board, 301..600);
    board.lost.clear();
    go(&mut board, 600..601);
    let to = board.seconds();
    go(&mut board, 601..900);
    let recorded = Recorded::new(&board);
    near(&spans(&recorded, "lost(2)"), &[(from, to)]);
    near(&spans(&recorded, "state == 0x18"), &[(from, to)]);
    assert_eq!(spans(&recorded, "lost(1)"), []);
    assert_eq!(spans(&recorded, "lost and state == OP"), []);
}

/// Times in which the FIFO was empty in a motion are found, from the first cycle without a target to the next one.
#[test]
fn a_gap_is_found() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 2);
    go(&mut board, 0..300);
    for _ in 0..40 {
        board.cycle();
    }
    go(&mut board, 300..600);
    let recorded = Recorded::new(&board);
    let gaps = spans(&recorded, "gap");
    let [(from, Some(to))] = gaps[..] else { panic!("{gaps:?}") };
    assert!((0.030..0.042).contains(&(to - from)), "{gaps:?}");
    assert_eq!(spans(&recorded, "gap and not gap"), []);
    assert_eq!(spans(&recorded, "gap and position(1) > 100").len(), 1);
}

/// What was not found in a damaged recording may be in what cannot be read.
#[test]
fn a_damaged_recording_has_no_never() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 2);
    go(&mut board, 0..300);
    let recorded = Recorded::new(&board);
    assert_eq!(find(&recorded, "alarm", &[]).code, Some(1));
    let whole = std::fs::read(&recorded.file).expect("a file");
    std::fs::write(&recorded.file, &whole[..whole.len() - 100]).expect("a file");
    assert_eq!(find(&recorded, "alarm", &[]).code, Some(2));
    assert_eq!(find(&recorded, "position(1) > 100", &[]).code, Some(0));
}

/// Names of the machine file have its units, numbers count, and a unit behind a number holds for both.
#[test]
fn a_name_has_units_and_a_number_counts() {
    let machine = text(
        "find_units.toml",
        "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.01 }\nY = { slave = 2, unit = \"mm\", per = -0.1 }\n",
    );
    let mut board = FakeBoard::new(SlotSize::Bytes12, 2);
    go(&mut board, 0..300);
    let recorded = Recorded::new(&board);
    let first = |expression: &str| {
        let ran = find(&recorded, expression, &["--machine", &machine]);
        assert_eq!(ran.code, Some(0), "{expression}: {ran:?}");
        ran.out.split_whitespace().next().expect("a time").to_owned()
    };
    let at = first("position(1) > 1000");
    for same in ["position(X) > 10", "position(1) > 10mm", "position(X) > 1000 counts", "10 < position(X)"] {
        assert_eq!(first(same), at, "{same}");
    }
    assert_eq!(first("velocity(1) > 9000 and position(1) > 1000"), at);
    assert_eq!(first("velocity(X) >= 90mm/s and position(X) > 10"), at);
    // Y counts in the other direction, and 20 of its counts are 2 mm.
    assert_eq!(first("position(Y) < -200"), at);
    assert_eq!(first("abs(position(Y)) > 200"), at);
    for (expression, column, word) in [
        ("position(1) - position(X) > 5", 15, "write units behind numbers"),
        ("position(1) - 5 > 5mm", 15, "write 5mm"),
        ("position(X) > 5deg", 1, "not in deg"),
        ("position(Z) > 5", 10, "has no axis `Z`"),
    ] {
        let ran = find(&recorded, expression, &["--machine", &machine]);
        assert_eq!(ran.code, Some(2), "{ran:?}");
        let place = format!("error: column {column} of the expression: ");
        assert!(ran.err.starts_with(&place) && ran.err.contains(word), "{expression}: {}", ran.err);
    }
}

/// A folder is no recording: what is one, and the verb that reads folders, are named.
#[test]
fn a_folder_is_told_to_be_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let name = folder.path().to_str().expect("a name");
    run(["find", "alarm", name]).expect_failure(2, &["is a folder; name a recording in it"], "ecmsk summary");
}

/// A wrong expression is an error with its column and the next step.
#[test]
fn a_wrong_expression_is_told_with_its_column() {
    let deep = format!("{}fault{}", "(".repeat(60), ")".repeat(60));
    for (expression, column, word) in [
        ("", 1, "it ends here"),
        ("position(1)", 1, "compare it, as in position(1) > 500"),
        ("position(1) > ", 15, "it ends here"),
        ("position(1) >> 5", 14, "`>` cannot stand here"),
        ("position > 5", 1, "of which axis? write position(1)"),
        ("positions(1) > 5", 1, "write `position`"),
        ("jerk(1) > 5", 1, "there are position, "),
        ("position(41) > 5", 10, "no axis"),
        ("position(X) > 5", 10, "no machine file"),
        ("position(1 > 5", 15, "`)` is missing"),
        ("(fault", 7, "`)` is missing"),
        ("fault fault", 7, "`and` or `or` is missing"),
        ("fault > 5", 1, "true or false and no number"),
        ("1 < position(1) < 5", 17, "join two with `and`"),
        ("3 > 2", 1, "nothing of the recording"),
        ("torque(1) > position(1)", 13, "a torque in %"),
        ("position(1) > 5 apples", 17, "`apples` is no unit"),
        ("position(1) > 1.2.3", 15, "`1.2.3` is no number"),
        ("unless fault", 1, "`unless` is not known"),
        (&*deep, 52, "nested deeper"),
    ] {
        let ran = run(["find", expression, "no such file"]);
        assert_eq!(ran.code, Some(2), "{expression}: {ran:?}");
        let place = format!("error: column {column} of the expression: ");
        assert!(ran.err.starts_with(&place) && ran.err.contains(word), "{expression}: {}", ran.err);
        assert!(ran.err.ends_with("see `ecmsk find --help`\n"), "{}", ran.err);
    }
    let json = run(["find", "x", "no such file", "--json"]);
    assert!(json.err.starts_with("{\"error\":\"column 1 of the expression: "), "{json:?}");
}

/// Runs the tool on a simulated board with two drives, and returns the path of the recording.
fn recorded(name: &str, script: &str, words: &[&str], code: i32) -> String {
    let script = text(&format!("{name}.script"), script);
    let path = file(&format!("{name}.pcapng"));
    let _ = std::fs::remove_file(&path);
    let path = path.display().to_string();
    let link = format!("sim:?slaves=drive*2&clock=virtual&script={script}&record={path}");
    run([words, &["--up", "--link", &link]].concat()).expect_code(code);
    path
}

/// How often the expression becomes true in a recording.
fn count(expression: &str, path: &str) -> usize {
    let ran = run(["find", expression, path]);
    assert!(matches!(ran.code, Some(0 | 1)), "{ran:?}");
    ran.out.lines().count()
}

/// Homing and alarms of drives are found, of one axis and of any.
#[test]
fn homing_and_alarms_are_found() {
    let homed = recorded("find_homed", "", &["home", "1"], 0);
    for (expression, expected) in
        [("homing(1)", 1), ("homing", 1), ("homing(2)", 0), ("homing(1) and not enabled(1)", 0), ("alarm", 0)]
    {
        assert_eq!(count(expression, &homed), expected, "{expression}");
    }
    let moved = recorded("find_alarm", "at 600ms alarm 2 0x7305\n", &["move", "1=10000", "2=-5000"], 1);
    for (expression, expected) in [
        ("alarm", 1),
        ("alarm(2) == 0x7305", 1),
        ("alarm(2) and alarm(2) != 0x7305 and alarm(2) != 0", 0),
        ("fault(1)", 0),
        ("gap", 0),
    ] {
        assert_eq!(count(expression, &moved), expected, "{expression}");
    }
}
