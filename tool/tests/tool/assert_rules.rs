//! `ecmsk assert`: recordings judged by rules.
#![cfg(target_os = "linux")]

use std::path::PathBuf;

use crate::common::{Ran, ecmsk, json_lines, run};

/// A folder with the recording of a run in virtual time: two axes go to OP, find home and move; then axis 2 has an alarm.
struct Recorded {
    folder: tempfile::TempDir,
}

impl Recorded {
    fn new() -> Self {
        let recorded = Self { folder: tempfile::tempdir().expect("a folder") };
        let steps = "state op\nservo on 1,2\nhome all\nmove 1=10000 2=-5000 --velocity 20000\nwait 100ms\n\
                     fault alarm 2 0x7500\nwait 50ms\n";
        let steps = recorded.text("steps.ecm", steps);
        let (file, control) = (recorded.at("run.ecmrec"), recorded.at("board"));
        let link = format!("sim:?slaves=drive*2&clock=virtual&control={}", control.display());
        run(["run", "--link", &link, "--record", file.to_str().expect("a path"), &steps]).expect_code(0);
        recorded
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str, text: &str) -> String {
        let file = self.at(name);
        std::fs::write(&file, text).expect("a file");
        file.display().to_string()
    }

    fn judge(&self, rules: &str, options: &[&str]) -> Ran {
        let rules = self.text("rules.toml", &format!("format = 1\n{rules}"));
        let file = self.at("run.ecmrec").display().to_string();
        run([&["assert", &file, &rules], options].concat())
    }
}

/// Rules that the run keeps: every kind has a line that says what was found.
#[test]
fn rules_are_kept() {
    let rules = "\
fail_on = [\"state\", \"gap\", \"velocity>1000000\"]
at_most = \"60s\"
at_least = \"1s\"
[axes.all]
torque = 100
[axes.1]
following_error = 5000
target_step = 1000
[[events]]
state = \"op\"
by = \"10s\"
[[events]]
homed = 1
within = \"5s\"
[[events]]
alarm = 2
code = 0x7500
not_before = \"500ms\"
[[never]]
alarm = 1
";
    let recorded = Recorded::new();
    let ran = recorded.judge(rules, &[]);
    assert_eq!((ran.code, &*ran.err), (Some(0), ""), "{}", ran.out);
    let lines: Vec<&str> = ran.out.lines().collect();
    let begins = [
        "kept: no state: none",
        "kept: no gap: none",
        "kept: no velocity>1000000: none",
        "kept: the run lasts at least 1 s: ",
        "kept: the run lasts at most 60 s: ",
        "kept: axis 1: following error at most 5000 counts: ",
        "kept: axis 1: target step at most 1000 counts: ",
        "kept: all axes: torque at most 100 %: ",
        "kept: event 1: OP is reached, by 10 s: at ",
        "kept: event 2: axis 1 is homed, within 5 s: at ",
        "kept: event 3: axis 2 has alarm 0x7500: communication, not before 0.5 s: at ",
        "kept: never: axis 1 has an alarm: it did not come",
    ];
    assert_eq!(lines.len(), begins.len(), "{}", ran.out);
    for (line, begin) in lines.iter().zip(begins) {
        assert!(line.starts_with(begin), "{line}");
    }
}

/// Rules that the run breaks, each alone: exit code 1, and what was found.
#[test]
fn broken_rules_are_named() {
    let recorded = Recorded::new();
    for (rules, says) in [
        ("fail_on = [\"alarm\"]", "broken: no alarm: 1 alarm(s)"),
        ("at_most = \"10ms\"", "broken: the run lasts at most 0.01 s: "),
        ("[axes.1]\nvelocity = 1000", "broken: axis 1: velocity at most 1000 counts/s: axis 1: velocity "),
        (
            "[axes.7]\ntorque = 100",
            "broken: axis 7: torque at most 100 %: no command for such an axis is in the recording",
        ),
        ("[[events]]\nhomed = 1\n[[events]]\nstate = \"op\"", "broken: event 2: OP is reached: it came at "),
        ("[[events]]\nstate = \"op\"\nby = \"1ms\"", "broken: event 1: OP is reached, by 0.001 s: at "),
        ("[[events]]\nstate = \"op\"\nnot_before = \"50s\"", "broken: event 1: OP is reached, not before 50 s: at "),
        (
            "[[events]]\nstate = \"op\"\n[[events]]\nalarm = 2\nwithin = \"1ms\"",
            "broken: event 2: axis 2 has an alarm, within 0.001 s: at ",
        ),
        ("[[events]]\nalarm = \"any\"\ncode = 0x5441", ": it did not come"),
        ("[[never]]\nalarm = \"any\"", "broken: never: any axis has an alarm: at "),
    ] {
        let ran = recorded.judge(rules, &[]);
        assert_eq!((ran.code, &*ran.err), (Some(1), ""), "{rules}: {}", ran.out);
        assert!(ran.out.lines().any(|line| line.contains(says)), "{rules}: {}", ran.out);
    }
}

/// Axes have the names and units of the machine file.
#[test]
fn axes_have_names_and_units() {
    let recorded = Recorded::new();
    let machine = "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.001 }\nY = { slave = 2, unit = \"mm\", per = 0.001 }\n";
    let machine = recorded.text("m.toml", machine);
    let rules = "[axes.X]\nvelocity = \"25 mm/s\"\n[axes.Y]\nvelocity = \"2mm/s\"\n[[events]]\nhomed = \"X\"\n";
    let ran = recorded.judge(rules, &["--machine", &machine]);
    assert_eq!(ran.code, Some(1), "{}", ran.out);
    let lines: Vec<&str> = ran.out.lines().collect();
    assert!(
        lines[0].starts_with("kept: axis X: velocity at most 25 mm/s: ") && lines[0].contains(" mm/s ("),
        "{}",
        ran.out
    );
    assert!(lines[1].starts_with("broken: axis Y: velocity at most 2mm/s: axis Y: velocity "), "{}", ran.out);
    assert!(lines[2].starts_with("kept: event 1: axis X is homed: at "), "{}", ran.out);
    recorded.judge(rules, &["--machine", "none"]).expect_failure(
        2,
        &["axes.X", "there is no machine file"],
        "--machine FILE",
    );
}

/// A recording on standard input is judged in the units of the machine file that it carries, as a file is.
#[test]
fn standard_input_has_the_units_that_it_carries() {
    let recorded = Recorded::new();
    let machine = |per: &str| format!("format = 1\n[axes]\nX = {{ slave = 1, unit = \"mm\", per = {per} }}\n");
    let own = recorded.text("own.toml", &machine("0.001"));
    let file = recorded.at("moved.ecmrec").display().to_string();
    let link = "sim:?slaves=drive&clock=virtual";
    run(["move", "X=2", "--up", "--machine", &own, "--link", link, "--record", &file]).expect_code(0);
    // In the units of the folder's file it is 1000 times as fast.
    recorded.text("machine.toml", &machine("1.0"));
    let rules = recorded.text("rules.toml", "format = 1\n[axes.X]\nvelocity = \"1000 mm/s\"\n");
    for name in [&*file, "-"] {
        let input = std::fs::File::open(&file).expect("the recording");
        let mut command = ecmsk(["assert", name, &rules]);
        let ran: Ran = command.stdin(input).current_dir(recorded.folder.path()).output().expect("it starts").into();
        assert!(ran.code == Some(0) && ran.out.starts_with("kept: axis X: velocity at most 1000 mm/s: "), "{ran:?}");
    }
}

/// The same as JSON, and as a file for services that show tests.
#[test]
fn results_are_data() {
    let recorded = Recorded::new();
    let junit = recorded.at("rules.xml").display().to_string();
    let ran = recorded.judge("fail_on = [\"gap\"]\n[[events]]\nalarm = 1\n", &["--json", "--junit", &junit]);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    let json = &json_lines(&ran.out)[0];
    assert_eq!(
        (&json["verb"], &json["broken"], &json["lacks"]),
        (&"assert".into(), &1.into(), &serde_json::Value::Null)
    );
    assert_eq!((&json["rules"][0]["kept"], &json["rules"][1]["kept"]), (&true.into(), &false.into()));
    assert_eq!(json["rules"][1]["rule"], "event 1: axis 1 has an alarm");
    let text = std::fs::read_to_string(junit).expect("the results");
    let document = roxmltree::Document::parse(&text).expect(&text);
    let suite = document.root_element();
    assert_eq!((suite.attribute("tests"), suite.attribute("failures")), (Some("2"), Some("1")), "{text}");
}

/// What cannot be judged has exit code 2: a recording that is not whole and breaks no rule, wrong rules, no recording.
#[test]
fn what_cannot_be_judged_is_told() {
    let recorded = Recorded::new();
    let file = recorded.at("run.ecmrec");
    let whole = std::fs::read(&file).expect("the recording");
    std::fs::write(&file, &whole[..whole.len() / 2]).expect("half of it");
    let ran = recorded.judge("fail_on = [\"state\"]", &[]);
    assert_eq!(ran.code, Some(2), "{}", ran.out);
    assert!(ran.err.starts_with("error: no rule is broken, but the recording is not whole: "), "{}", ran.err);
    recorded.judge("at_most = \"1ms\"", &[]).expect_code(1);
    std::fs::write(&file, whole).expect("the recording");
    recorded.judge("[[events]]\nstate = \"up\"", &[]).expect_failure(
        2,
        &["rules.toml: events, number 1"],
        "safeop, op",
    );
    let ran = run(["assert", file.to_str().expect("a path"), "/no/such/rules.toml"]);
    ran.expect_failure(2, &["cannot read the rules /no/such/rules.toml"], "name another file");
    let rules = recorded.at("rules.toml").display().to_string();
    run(["assert", "/no/such/run.pcapng", &rules]).expect_code(2);
}
