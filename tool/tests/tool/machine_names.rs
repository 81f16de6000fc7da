//! The machine file in all verbs: its link, the names and units of its axes, and its words for alarms.

use crate::common::{Ran, ecmsk, json_lines};
use crate::machine_file::{Folder, MACHINE, SAID};

/// A verb that takes a link uses that of the machine file, behind `--link` and `ECMSK_LINK`, and knows the names of its axes.
#[test]
fn every_verb_knows_the_link_and_the_axes_of_the_file() {
    let folder = Folder::new(&MACHINE.replace("sim:?clock=virtual", "sim:"));
    for (words, says) in [
        (&["bus", "scan"] as &[&str], "3  "),
        (&["bus", "sdo", "read", "turn", "0x6098", "--json"], "\"slave\":2"),
        (&["bus", "sii", "read", "turn", "--json"], "\"slave\":2"),
        (&["params", "backup", "turn", "--output", "turn.params", "--json"], "\"slave\":2"),
        (&["sdo", "read", "x", "statusword", "--json"], "\"slave\":1"),
        (&["info"], "network     1 drive, 2 drive, 3 io"),
    ] {
        let ran = folder.run(words);
        assert!(ran.code == Some(0) && ran.out.contains(says), "{words:?} {ran:?}");
        assert_eq!(ran.err.matches(SAID).count(), 1, "{words:?} {ran:?}");
    }
    let same = folder.run(&["params", "diff", "turn.params", "turn"]);
    assert!(same.code == Some(0) && same.err.contains("0 parameters differ"), "{same:?}");
    let same = folder.run(&["params", "restore", "turn.params", "turn", "--yes"]);
    assert_eq!(same.code, Some(0), "{same:?}");
    let doctor = folder.run(&["doctor", "--quick", "--json"]);
    let link = json_lines(&doctor.out).into_iter().find(|line| line["check"] == "link").expect("a finding");
    let found = link["found"].as_str().expect("words");
    assert!(found.starts_with("sim:") && found.contains(", from machine.toml; ECMSK_LINK is not set"), "{found}");

    // `--link` and ECMSK_LINK come first, and a number needs no file then.
    let scan = |words: &[&str]| json_lines(&folder.run(&[&["bus", "scan", "--json"], words].concat()).out).len();
    assert_eq!((scan(&[]), scan(&["--link", "sim:?slaves=drive"])), (3, 1));
    let words = ["params", "backup", "1"];
    let run = |words: &[&str]| {
        let mut command = ecmsk(words);
        let command = command.current_dir(folder.0.path()).env("ECMSK_LINK", "sim:?slaves=io");
        Ran::from(command.output().expect("the tool starts"))
    };
    assert!(run(&words).out.contains(" of sim:?slaves=io, "));
    let none = run(&["bus", "sdo", "read", "turn", "statusword"]);
    assert!(none.code == Some(1) && none.err.contains("slave 2"), "{none:?}");
    folder.run(&["bus", "sdo", "read", "Z", "statusword"]).expect_code(2);
    let none = folder.run(&["params", "backup", "X", "--machine", "none", "--link", "sim:?slaves=drive"]);
    none.expect_failure(2, &["axis `X` is no number from 1 to 40, and there is no machine file"], "say --machine FILE");
    folder.write("machine.toml", "format = 1\n[axes]\nX = { slave = 1, per = 0 }\n");
    let scan = folder.run(&["bus", "scan", "--link", "sim:?slaves=drive"]);
    assert_eq!((scan.code, scan.err.as_str()), (Some(0), ""), "{scan:?}");
    folder.run(&["bus", "scan"]).expect_failure(1, &["axes.X.per: 0 is no scale"], "write the units");
    let doctor = folder.run(&["doctor", "--quick"]);
    assert!(doctor.code == Some(1) && doctor.out.contains("axes.X.per: 0 is no scale"), "{doctor:?}");
}

/// `--counts-per-unit` is for axes that are named by their numbers: one with a name has the unit of the file.
#[test]
fn counts_per_unit_are_not_for_axes_with_names() {
    let folder = Folder::new(MACHINE);
    let of_all = ["--counts-per-unit", "10000", "--up"];
    for words in [
        &["move", "X=100"] as &[&str],
        &["move", "1=100", "turn=5"],
        &["home", "X", "--offset", "1"],
        &["servo", "on", "X"],
        &["move", "X=500counts"],
    ] {
        let ran = folder.run(&[words, &of_all].concat());
        assert!(ran.code == Some(1) && ran.out.is_empty(), "{words:?} {ran:?}");
        assert!(
            ran.err.contains(" from the machine file, and --counts-per-unit is for axes that are named by"),
            "{ran:?}"
        );
        assert!(
            ran.err.trim_end().ends_with("; leave out --counts-per-unit, or name the axis 1")
                || ran.err.trim_end().ends_with("or name the axis 2"),
            "{ran:?}"
        );
    }
    folder.write("program", "state op\nservo on 1\nmove 1=1\nexpect position X=1\n");
    let ran = folder.run(&["run", "program", "--counts-per-unit", "1000"]);
    assert!(ran.code == Some(1) && ran.err.contains("program:4: expect: axis X has its unit"), "{ran:?}");
    // A value for another axis says nothing of it.
    let ran = folder.run(&["move", "X=2.5", "2=9", "--counts-per-unit", "2=1000", "--up"]);
    assert_eq!(ran.out, "axis X: at 2.5 mm (2500 counts)\naxis turn: at 9 (9000 counts)\n", "{ran:?}");
}

/// A target that the nearest count puts to another place is named before the axis moves.
#[test]
fn a_target_that_is_rounded_to_another_place_is_named() {
    let folder = Folder::new(
        "format = 1\nlink = \"sim:?clock=virtual\"\n[axes]\nX = { slave = 1, unit = \"mm\", per = 1000 }\n",
    );
    let ran = folder.run(&["move", "X=250", "--up"]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), "axis X: at 0 mm (0 counts)\n"), "{ran:?}");
    assert!(ran.err.contains("note: axis X: 250 mm is rounded to 0 mm, since a count is 1000 mm\n"), "{ran:?}");
    let ran = folder.run(&["move", "X=20400", "--up"]);
    assert!(ran.out == "axis X: at 20000 mm (20 counts)\n" && !ran.err.contains("rounded"), "{ran:?}");
    let ran = folder.run(&["move", "1=0.4", "--up", "--counts-per-unit", "1"]);
    assert!(ran.code == Some(1) && ran.err.contains("no whole number of counts"), "{ran:?}");
}

/// A homing method that neither CiA 402 nor a maker has is allowed, and `machine check` advises to look at the manual.
#[test]
fn a_check_advises_on_a_homing_method_that_nobody_has() {
    let axis = |name: &str, slave: u8, method: i32| {
        format!("{name} = {{ slave = {slave}, homing = {{ method = {method} }} }}\n")
    };
    let methods = [("A", 0), ("B", 1), ("C", 37), ("D", 38), ("E", 99), ("F", -1), ("G", -128), ("H", 127)];
    let axes = (1..).zip(methods).map(|(slave, (name, method))| axis(name, slave, method));
    let folder = Folder::new(&format!("format = 1\n[axes]\n{}", axes.collect::<String>()));
    let ran = folder.run(&["machine", "check"]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let said = |name: &str, method| {
        format!(
            "note: axis {name} has homing method {method}, which CiA 402 does not have: it has 1 to 37, and those below 0 are the \
             maker's; see the manual of the drive\n"
        )
    };
    assert_eq!(ran.err, [("A", 0), ("D", 38), ("E", 99), ("H", 127)].map(|(name, method)| said(name, method)).concat());
}

/// Errors and notes have the names, the units and the words for alarms of the file in every verb that commands axes, and in
/// `flight list`.
#[test]
fn errors_and_notes_have_names_units_and_words() {
    let folder = Folder::new(MACHINE);
    folder.write("alarm", "at 1s alarm 1 0x7500 stays\n");
    let link = "sim:?slaves=drive*2,io&clock=virtual&script=alarm&flight=flight";
    let words = "axis X has alarm 0x7500: the red cable; remove the cause";
    for step in ["servo clear X", "servo on 1", "home X", "move X=5", "expect alarm X=0x1000"] {
        folder.write("program", &format!("state op\nwait 2s\n{step}\n"));
        let ran = folder.run(&["run", "program", "--link", link]);
        let words =
            if step.starts_with("expect") { "axis X has alarm 0x7500: the red cable, not 0x1000" } else { words };
        assert!(ran.code == Some(1) && ran.err.contains(words), "{step}: {ran:?}");
    }
    folder.write("program", "state op\nwait 2s\nsdo read X 0x603F\n");
    let read = folder.run(&["run", "program", "--link", link]);
    assert!(read.out.contains("(0x7500): the red cable\n"), "{read:?}");
    let kept = folder.run(&["flight", "list", "flight"]);
    assert!(kept.out.contains("  alarm: axis X has an alarm, 0x7500: the red cable\n"), "{kept:?}");
    let none = folder.run(&["flight", "list", "flight", "--machine", "none"]);
    assert!(none.out.contains("  alarm: slave 1 has an alarm, 0x7500: "), "{none:?}");

    for (words, says) in [
        (
            &["move", "X=200", "--velocity", "99", "--lead-limit", "1000"] as &[&str],
            "at 99.000 mm/s the target of axis X runs 6.336 mm ahead of it, the limit is 1.000 mm",
        ),
        (&["move", "turn=1", "2=5"], "axis turn is named twice"),
        (&["move", "X=1000.5counts"], "1000.5 of axis X is no whole number of counts"),
        (
            &["move", "X=3000000"],
            "target 3000000 of axis X is outside the 32 bits of a position; name one from -2147483.648 to",
        ),
        (&["move", "X=100", "--velocity", "1.5"], "this move takes 1 min 7 s, for 100 mm (100000 counts); --velocity"),
    ] {
        let ran = folder.run(&[words, &["--up"]].concat());
        assert!(ran.err.contains(says), "{words:?} {ran:?}");
    }
    folder.write("program", "state op\nservo on X,2\nstate preop\n");
    let ran = folder.run(&["run", "program"]);
    assert!(ran.err.contains("leaving OP switches off axes X, turn\n"), "{ran:?}");
}

/// A target that is none says that a decimal point is used, and which axes the machine file has.
#[test]
fn a_wrong_target_names_the_decimal_point_and_the_axes() {
    let folder = Folder::new(MACHINE);
    folder.write("other.toml", "format = 1\n[axes]\nleft = { slave = 1 }\n");
    let axes = "an axis from 1 to 40 or one of machine.toml: X, turn; and ";
    let number = "a number, with a decimal point if it has decimals";
    for (words, says) in [
        (&["X=12,5"] as &[&str], format!("{axes}a number with a decimal point, X=12.5")),
        (&["X=12,5mm"], format!("{axes}a number with a decimal point, X=12.5mm")),
        (&["X"], format!("{axes}{number}")),
        (&["X=nan"], format!("{axes}{number}")),
        (&["X=1,2,3"], format!("{axes}{number}")),
        (&["X", "--machine", "other.toml"], "or one of other.toml: left; and ".to_owned()),
        (&["--machine=other.toml", "X"], "or one of other.toml: left; and ".to_owned()),
        (&["X", "--machine", "none"], "or a name of the machine file; and ".to_owned()),
    ] {
        let ran = folder.run(&[&["move"], words].concat());
        assert_eq!(ran.code, Some(2), "{words:?} {ran:?}");
        assert!(ran.err.contains(&says), "{words:?} `{says}` {ran:?}");
    }
}
