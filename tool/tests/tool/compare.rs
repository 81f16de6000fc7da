//! `ecmsk compare`: exit codes, words, JSON and picture of two recordings.

use std::fs;
use std::path::Path;

use crate::common::motion::FakeBoard;
use crate::common::svg::{ALARM, COLOURS, Plot};
use crate::common::{Ran, run};
use ecmsk::sk::SlotSize;
use serde_json::Value;
use support::recorded::{BEFORE, Program, Run, TARGETS};

fn compare(a: &Run, b: &Run, options: &[&str]) -> Ran {
    run([&["compare", a.path(), b.path()], options].concat())
}

/// Exit codes are those of diff: 0 equal, 1 different, 2 not compared, and 2 for a wrong command line, too.
#[test]
fn exit_codes_are_those_of_diff() {
    let a = Program::default().record();
    let slower = Program { keys: "&host_us=400".into(), polls: 1, ..Program::default() }.record();
    let other = Program { other_target: Some((7, 1)), ..Program::default() }.record();
    let out = compare(&a, &slower, &[]).expect_quiet();
    assert!(out.contains("\nequal: 308 commands and 30"), "{out}");
    let different = compare(&a, &other, &[]);
    assert_eq!((different.code, different.err.as_str()), (Some(1), ""));
    run(["compare", a.path(), "/no/such/file"]).expect_failure(2, &["/no/such/file"], "check the path");
    run(["compare", a.path(), "-"]).expect_failure(2, &["standard input"], "save it to a file");
    run(["compare", a.path()]).expect_misuse(&["<B>"]);
    compare(&a, &a, &["--statusword-mask", "x"]).expect_misuse(&["--statusword-mask", "0x006F"]);
    let nothing = a.file.with_file_name("nothing.pcapng");
    fs::write(&nothing, "no recording").expect("a file");
    run(["compare", a.path(), nothing.to_str().expect("UTF-8")]).expect_failure(
        2,
        &["is no recording (.ecmrec, .pcapng)"],
        "with Wireshark",
    );
    let help = run(["--help"]).expect_quiet();
    assert!(help.contains("0 the recordings are equal, 1 they differ, 2 they could not be compared"), "{help}");
}

/// The text of `compare` names both files and their content, the commands before the difference, the difference, and the
/// commands after it.
#[test]
fn the_output_names_both_files_the_commands_before_and_the_difference() {
    let a = Program::default().record();
    let b = Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() }.record();
    let ran = compare(&a, &b, &[]);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    let lines: Vec<_> = ran.out.lines().collect();
    assert_eq!(lines[0], format!("A is {}", a.path()));
    assert_eq!(lines[1], format!("B is {}", b.path()));
    assert!(
        lines[2].starts_with("A: 308 commands, 0 polls, ") && lines[3].starts_with("B: 304 commands, "),
        "{}",
        ran.out
    );
    assert_eq!(lines[4], "first difference:");
    assert!(lines[5..8].iter().all(|line| line.starts_with("  command ") && line.ends_with(": equal")), "{}", ran.out);
    let first = lines[8];
    for words in [
        "(slave 2 CSP #",
        " s in A, ",
        " s in B: slave 2 statusword 0x1",
        "(Operation enabled) in A, 0x",
        "error code 0x0000 in A, 0x7500 (communication) in B",
    ] {
        assert!(first.contains(words), "`{words}` is missing in: {first}");
    }
    assert!(lines[9].starts_with("answers to ") && lines[9].ends_with(" later commands differ too"), "{}", ran.out);
    assert_eq!(lines[10], "B ends early: 304 of 308 commands");
    // `dump` shows the frame of the first difference under the number that the JSON gives.
    let json = compare(&a, &b, &["--json"]).json();
    let frame = json["first"]["frames"][1].as_u64().expect("a number");
    let dump = run(["dump", b.path(), "--slots", "2", "--commands", "CSP"]).expect_quiet();
    let number = json["first"]["text"].as_str().expect("a text").replace("slave 2 ", "");
    let place = dump.find(&format!("frame {frame} ")).expect("the frame");
    assert!(dump[place..].lines().nth(1).expect("a line").contains(&number), "{number}");
}

/// `--json` prints the result as one JSON object, with numbers for programs.
#[test]
fn json_has_the_comparison_as_one_object() {
    let a = Program::default().record();
    let b = Program { other_target: Some((100, 5)), ..Program::default() }.record();
    let found = compare(&a, &b, &["--json"]).json();
    assert_eq!((&found["equal"], &found["first"]["command"]), (&false.into(), &(BEFORE + 101).into()));
    assert_eq!(found["first"]["what"][0]["of"], "command");
    assert_eq!(found["context"].as_array().expect("a list").len(), 3);
    assert_eq!((&found["a"]["commands"], &found["a"]["file"]), (&308.into(), &a.path().into()));
    let b = Program { home_offset: 5, ..Program::default() }.record();
    let found = compare(&a, &b, &["--json"]).json();
    assert_eq!(found["first"]["text"], "SDO SDO_WR slave 1 0x607C:0 u32 = 0", "{found}");
    let b = Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() }.record();
    let found = compare(&a, &b, &["--json"]).json();
    let what = &found["first"]["what"][0];
    assert_eq!((&what["of"], &what["slave"], &what["values"][0]), (&"statusword".into(), &2.into(), &0x1237.into()));
    assert_eq!(found["ends_early"], "b");
    let equal = compare(&a, &a, &["--json"]).json();
    assert_eq!((&equal["equal"], &equal["first"], &equal["ends_early"]), (&true.into(), &Value::Null, &Value::Null));
}

/// A board whose slaves are behind a chip answers later. The output has the latency in words and as numbers, and the
/// exit code is 0 unless it is more than allowed.
#[test]
fn the_latency_of_a_chip_is_told() {
    let a = Program::default().record();
    let b = Program { scheme: "xf-sim", ..Program::default() }.record();
    let out = compare(&a, &b, &[]).expect_quiet();
    assert!(out.contains("\nlatency: B answers ") && out.contains(" commands that did not wait; from "), "{out}");
    assert!(out.contains("\nequal: 308 commands and "), "{out}");
    let found = compare(&a, &b, &["--json"]).json();
    let latency = &found["latency"];
    let cycles = |key: &str| latency[key].as_i64().unwrap_or_else(|| panic!("{key} in {found}"));
    let usual = cycles("usual_cycles");
    assert!((1..=8).contains(&usual) && cycles("least_cycles") <= usual && usual <= cycles("most_cycles"), "{found}");
    assert!(cycles("commands") >= 4 && latency["stretches"][0]["from_command"] == 4, "{found}");
    assert_eq!((&found["equal"], &found["b"]["gaps"]["count"]), (&true.into(), &0.into()));
    assert!(found["shifted_answers"].as_u64().is_some_and(|count| count > 0), "{found}");
    // With packets of 1024 bytes of data each answer is late by the same number of cycles.
    let b = Program { scheme: "xf-sim", keys: "&use_n=1024".into(), ..Program::default() }.record();
    let usual = compare(&a, &b, &["--json"]).json()["latency"]["usual_cycles"].as_i64().expect("a number");
    let late = compare(&a, &b, &["--latency", &(usual - 1).to_string(), "--json"]);
    assert_eq!(late.code, Some(1), "{}", late.out);
    assert_eq!(late.json()["first"]["what"][0]["of"], "late", "{}", late.out);
    compare(&a, &b, &["--latency", &usual.to_string()]).expect_quiet();
    assert_eq!(compare(&a, &b, &["--latency", "0"]).code, Some(1));
    compare(&a, &b, &["--latency", "soon"]).expect_misuse(&["--latency"]);
}

/// A latency counts also if only one command shows it. If it is a cycle more than `--latency` allows, it is a difference, and
/// the message says at which command.
#[test]
fn one_command_tells_a_latency_that_is_too_long() {
    let run = |scheme| Program { scheme, short: true, ..Program::default() }.record();
    let (a, b) = (run("sim"), run("xf-sim"));
    let found = compare(&a, &b, &["--json"]).json();
    let usual = found["latency"]["usual_cycles"].as_i64().expect("a number");
    assert!(usual > 0 && found["latency"]["commands"].as_u64().is_some_and(|commands| commands < 5), "{found}");
    let late = compare(&a, &b, &["--latency", &(usual - 1).to_string()]);
    assert_eq!(late.code, Some(1), "{}", late.out);
    assert!(late.out.contains(&format!("B answers {usual} cycles later from command ")), "{}", late.out);
    compare(&a, &b, &["--latency", &usual.to_string()]).expect_quiet();
}

/// `compare` reports the gaps in the motions of a recording, with the number of cycles of each.
#[test]
fn gaps_are_told() {
    let a = Program::default().record();
    let b = Program { pauses: &[(60, 14), (150, 11)], ..Program::default() }.record();
    let out = compare(&a, &b, &[]).expect_quiet();
    assert!(out.contains("\nB: 2 gaps of 17 cycles together, the longest 11\n"), "{out}");
    let found = compare(&a, &b, &["--json"]).json();
    let gaps = &found["b"]["gaps"];
    assert_eq!((&gaps["count"], &gaps["cycles"], &gaps["longest_cycles"]), (&2.into(), &17.into(), &11.into()));
    assert_eq!(found["a"]["gaps"]["count"], 0);
}

/// The picture of `--plot` shows the positions of both runs over the commands, their difference, and a mark where the
/// difference begins.
#[test]
fn the_picture_shows_both_positions_and_marks_where_they_differ() {
    let a = Program::default().record();
    let b = Program { other_target: Some((100, 500)), ..Program::default() }.record();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("difference.svg");
    let ran = compare(&a, &b, &["--plot", file.to_str().expect("UTF-8")]);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    assert!(ran.out.ends_with(&format!("\npicture: {}\n", file.display())), "{}", ran.out);
    let plot = Plot::parse(&fs::read_to_string(&file).expect("a picture"));
    assert_eq!(
        plot.panel_names(),
        ["Axis 1: position (counts)", "Axis 2: position (counts)", "Difference: B minus A (counts)"]
    );
    let command = (BEFORE + 101) as f64;
    for name in ["Axis 1", "Axis 2", "Difference"] {
        let marks = plot.panel(name).samples(ALARM, false);
        let upright: Vec<_> = marks.iter().filter(|(at, _)| (at - command).abs() < 0.5).collect();
        assert_eq!(upright.len(), 2, "{name}: {marks:?}");
    }
    // Axis 2 ends at its last target in the curves of both runs: A is the pale one.
    let end = BEFORE as f64 + f64::from(TARGETS);
    for pale in [true, false] {
        let position = plot.panel("Axis 2").at(COLOURS[1], pale, end);
        assert!((position - 6000.0).abs() < 60.0, "{position}");
    }
    let difference = plot.panel("Difference").samples(COLOURS[1], false);
    let largest = difference.iter().map(|(_, counts)| *counts).fold(0.0, f64::max);
    assert!(largest > 50.0, "{largest}");
    assert!(difference.iter().filter(|(at, _)| *at < command - 1.0).all(|(_, counts)| counts.abs() < 5.0));
    assert!(plot.texts().contains(&"first difference: command 105"), "{:?}", plot.texts());
    compare(&a, &b, &["--plot", a.path()]).expect_failure(2, &["would replace the recording"], "with --plot");
    compare(&a, &b, &["--plot", "/no/such/folder/x.svg"]).expect_failure(2, &["cannot write"], "with --plot");
    assert!(Path::new(a.path()).exists());
}

/// A recording that is cut off is compared up to its end, and a note says so.
#[test]
fn a_recording_that_is_cut_off_is_compared_as_far_as_it_goes() {
    let a = Program::default().record();
    let bytes = fs::read(&a.file).expect("a recording");
    let cut = a.file.with_file_name("cut.pcapng");
    fs::write(&cut, &bytes[..bytes.len() / 2 + 1]).expect("a file");
    let ran = run(["compare", a.path(), cut.to_str().expect("UTF-8")]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.err.starts_with("note: B: ") && ran.err.contains("ends in the middle"), "{}", ran.err);
    assert!(ran.out.contains("B ends early: "), "{}", ran.out);
}

/// If only positions differ, and by no more than noise, the message names the tolerance with which the recordings are
/// equal; otherwise it names none.
#[test]
fn the_tolerance_that_would_settle_it_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let record = |name: &str, apart: i32, error_code: u16| {
        let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
        for n in 0..60 {
            board.send(&[if n < 40 { 0 } else { 5 }]);
            board.positions[0] = if n < 20 { 0 } else { apart - i32::from(n < 30) };
            board.drives[0].error_code = error_code;
            board.cycle();
        }
        let file = folder.path().join(name);
        board.script.record(&file, "sim:?clock=virtual", Some(SlotSize::Bytes12));
        file.to_str().expect("UTF-8").to_owned()
    };
    let (a, near, far, other) =
        (record("a", 1, 0), record("near", 4, 0), record("far", 5000, 0), record("other", 4, 0x7500));
    let found = run(["compare", &a, &near]);
    assert_eq!(found.code, Some(1), "{found:?}");
    let (_, named) = found.out.split_once("--tolerance ").expect(&found.out);
    let counts = named.split(' ').next().expect("a number");
    let settled = run(["compare", &a, &near, "--tolerance", counts]);
    assert!(settled.code == Some(0) && !settled.out.contains("--tolerance"), "{settled:?}");
    let less = (counts.parse::<u32>().expect("a number") - 1).to_string();
    assert_eq!(run(["compare", &a, &near, "--tolerance", &less]).code, Some(1));
    let json: Value = serde_json::from_str(&run(["compare", &a, &near, "--json"]).out).expect("an object");
    assert_eq!(json["settling_tolerance_counts"].to_string(), counts);
    for b in [&far, &other] {
        let found = run(["compare", &a, b]);
        assert!(found.code == Some(1) && !found.out.contains("--tolerance"), "{found:?}");
    }
}
