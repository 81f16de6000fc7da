//! Details of the command line that people meet first: units, numbers, allowed values, errors as JSON, and the file
//! that names the link.

use std::fs;

use crate::common::board::{BOARD, script};
use crate::common::{Ran, ecmsk, run};
use serde_json::{Value, json};

fn object(ran: &Ran) -> Value {
    let line = ran.out.lines().last().unwrap_or_else(|| panic!("{ran:?}"));
    serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {ran:?}"))
}

/// `home`, `move` and `info` use the units of --counts-per-unit.
#[test]
fn home_move_and_info_use_the_units_of_counts_per_unit() {
    let units = ["--counts-per-unit", "1=1000,2=-500", "--link", BOARD, "--up"];
    let with = |words: &[&str]| run(words.iter().chain(&units).copied());
    assert_eq!(
        with(&["home", "1", "--method", "37", "--offset", "2.5"]).out,
        "axis 1: home found (method 37), at 2.5 (2500 counts)\n"
    );
    assert_eq!(with(&["move", "1=2.5", "2=1.5"]).out, "axis 1: at 2.5 (2500 counts)\naxis 2: at 1.5 (-750 counts)\n");
    let json = object(&with(&["home", "2", "--method", "37", "--offset", "-4", "--json"]));
    assert_eq!((&json["position"], &json["position_counts"]), (&json!(-4.0), &json!(2000)));
    let lines = "move 1=2.5\ninfo\n";
    let ran = crate::common::run_with_input(&["run", "-", "--counts-per-unit", "1000", "--up", "--link", BOARD], lines);
    assert!(ran.out.contains("Operation enabled (0x1637), at 2.5 (2500 counts)\n"), "{ran:?}");
}

/// Without units a position is a whole number of counts: half a count is refused and not rounded.
#[test]
fn half_a_count_is_refused() {
    for words in [&["move", "1=2.5"] as &[_], &["move", "1=0.5", "--relative"], &["home", "1", "--offset", "0.5"]] {
        let ran = run(words.iter().copied().chain(["--link", BOARD, "--up"]));
        ran.expect_failure(1, &["of axis 1 is no whole number of counts", "--counts-per-unit"], "what a unit is");
    }
    assert_eq!(run(["move", "1=3.0", "--link", BOARD, "--up"]).out, "axis 1: at 3\n");
}

/// `info --json` lists the slaves in every state of the network: their kinds, and in OP also their values.
#[test]
fn info_as_json_has_the_slaves_in_every_state() {
    let slaves = |ran: &Ran| object(ran)["slaves"].as_array().expect("a list").clone();
    let known = slaves(&run(["info", "--json", "--link", BOARD]));
    let kinds =
        [json!({"slave": 1, "kind": "drive"}), json!({"slave": 2, "kind": "drive"}), json!({"slave": 3, "kind": "io"})];
    assert_eq!(known, kinds);
    let ran = crate::common::run_with_input(&["run", "-", "--json", "--link", BOARD], "state op\ninfo\n");
    let told = slaves(&ran);
    assert_eq!(told.len(), 3, "{told:?}");
    for (told, known) in told.iter().zip(kinds) {
        assert_eq!((&told["slave"], &told["kind"]), (&known["slave"], &known["kind"]));
    }
    assert_eq!(told[0]["position_counts"], 0);
}

/// An index without 0x is not read as a decimal number by mistake: the error asks what was meant.
#[test]
fn an_index_without_0x_is_questioned() {
    for (written, meant) in [("6041", "`0x6041`"), ("609A:1", "`0x609A:1`"), ("1018:4", "`0x1018:4`")] {
        let ran = run(["sdo", "read", "1", written, "--link", BOARD]);
        assert!(ran.code == Some(2) && ran.err.contains(&format!("did you mean {meant}?")), "{ran:?}");
    }
    assert_eq!(run(["sdo", "read", "1", "0x6098", "--link", BOARD]).out, "35 (0x23)\n");
}

/// If a word after `expect`, or after another verb with sub-verbs, is unknown or missing, the error lists the words that may
/// follow.
#[test]
fn an_unknown_word_behind_a_verb_lists_the_allowed_ones() {
    for (line, wrong) in [("expect", "a word is missing"), ("expect foo 1", "`foo 1` is unknown")] {
        let allowed = "; allowed behind `expect`: state, position, velocity, torque, alarm, inputs, sdo, time, counter; `help expect` says more";
        let ran = script(BOARD, line);
        assert!(ran.code == Some(1) && ran.err.contains(&format!("{wrong}{allowed}")), "{ran:?}");
    }
    for (line, allowed) in [
        ("expect state foo", "allowed: init, preop, safeop, op"),
        ("expect position 1", "allowed: AXIS=TARGET, e.g. 1=10000"),
        ("expect inputs 3", "allowed: SLAVE=BITS, e.g. 3=0x0001"),
        ("sdo frobnicate", "allowed behind `sdo`: read, write"),
    ] {
        let ran = script(BOARD, line);
        assert!(ran.code == Some(1) && ran.err.contains(allowed), "{ran:?}");
    }
}

/// With --json the last line on standard error is an object of the error and the exit code, also for a command line
/// that is wrong; standard output has only results.
#[test]
fn with_json_an_error_is_an_object_on_standard_error() {
    for (words, code, part) in [
        (&["move", "1=2.5", "--json", "--link", BOARD, "--up"] as &[_], 1, "no whole number of counts"),
        (&["sdo", "read", "1", "statuswrod", "--json", "--link", BOARD], 2, "did you mean `statusword`?"),
        (&["state", "--json", "--frobnicate"], 2, "unexpected argument '--frobnicate'"),
        (&["summary", "--json", "no such file"], 1, "no such file"),
        (&["compare", "--json", "no such file", "nor this"], 2, "no such file"),
        (&["migrate", "--json", "no such file"], 2, "no such file"),
    ] {
        let ran = run(words);
        let last = ran.err.lines().last().expect("a line");
        let error: Value = serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}: {ran:?}"));
        assert!(error["error"].as_str().is_some_and(|text| text.contains(part)), "{ran:?}");
        assert_eq!((error["exit_code"].as_i64(), ran.code, ran.out.as_str()), (Some(code.into()), Some(code), ""));
    }
    // Words behind -- belong to the program.
    let ran = run(["exec", "--library", "nowhere", "--", "true", "--json"]);
    assert!(ran.err.starts_with("error: no "), "{ran:?}");
}

/// The tool finds the `ecmsk.toml` of the folder that it is started in, before those elsewhere, and says so; the
/// option and the variable come first.
#[test]
fn the_ecmsk_toml_of_the_working_directory_names_the_link() {
    let folder = tempfile::tempdir().expect("a folder");
    let info = |words: &[&str], variable: &str| {
        let mut command = ecmsk(["info"]);
        command.args(words).current_dir(folder.path()).env("ECMSK_LINK", variable);
        Ran::from(command.output().expect("the tool starts"))
    };
    let file = folder.path().join("ecmsk.toml");
    fs::write(&file, "link = \"sim:?slaves=drive*7&clock=virtual\"\n").expect("a file");
    let ran = info(&[], "");
    assert!(ran.out.starts_with("link        sim:?slaves=drive*7&clock=virtual\n"), "{ran:?}");
    let name = file.canonicalize().expect("it is there");
    assert_eq!(ran.err, format!("note: link from {}: sim:?slaves=drive*7&clock=virtual\n", name.display()));
    for (words, variable) in [(&["--link", BOARD] as &[_], ""), (&[], BOARD)] {
        let ran = info(words, variable);
        assert!(ran.err.is_empty() && ran.out.contains(BOARD), "{ran:?}");
    }
    fs::write(&file, "nonsense").expect("a file");
    assert!(info(&[], "").err.contains("ecmsk.toml, line 1: "));
}
