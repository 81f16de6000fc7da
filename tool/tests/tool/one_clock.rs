//! One clock: a run has the same times in its script, in the warnings of `exec`, and in what the tool shows of its recording.
#![cfg(target_os = "linux")]

/// Programs in C on the libraries of this build.
mod needs_cxx {
    use std::fs;
    use std::path::Path;

    use serde_json::Value;
    use support::Language;

    use crate::common::{Ran, ecmsk, json_lines, run};

    /// Runs a program that waits 2.5 s after it has opened its board, and records it.
    fn recorded(file: &Path, script: &Path, arguments: &[&str]) -> Ran {
        let program = support::compile(&support::root().join("tests/c/late.c"), Language::C("c11")).exe;
        let link = format!("sim:?slaves=drive&script={}", script.display());
        let mut command = ecmsk(["exec", "--clock", "virtual", "--link", &link, "--library"]);
        command.arg(&support::library().shared).arg("--record").arg(file).arg("--").arg(program).args(arguments);
        command.output().expect("the tool starts").into()
    }

    fn text(path: &Path) -> &str {
        path.to_str().expect("UTF-8")
    }

    /// The time of the first report with the alarm, or of OP, by `dump`.
    fn dumped(frames: &[Value], word: &str) -> f64 {
        let has = |frame: &&Value| frame["direction"] == "response" && frame.to_string().contains(word);
        frames.iter().find(has).and_then(|frame| frame["time_ns"].as_f64()).expect(word) / 1e9
    }

    /// An alarm that a script begins at 4 s has one time in the warning of `exec`, and by `dump`, `summary`, `find`, `assert`
    /// and `plot` of the recording: since the board was opened, also if the first frame comes 2.5 s later. If it was opened
    /// again after a second, the script counts from then on, and all others go on in the recording.
    #[test]
    fn an_alarm_has_one_time() {
        let folder = tempfile::tempdir().expect("a folder");
        let [script, rules] = ["script", "rules.toml"].map(|name| folder.path().join(name));
        fs::write(&script, "at 4s alarm 1 0x7500\n").expect("a file");
        for (name, arguments, begins_s) in
            [("late.pcapng", &[][..], 4), ("late.ecmrec", &[], 4), ("again.pcapng", &["again"], 5)]
        {
            let file = folder.path().join(name);
            let ran = recorded(&file, &script, arguments);
            assert_eq!(ran.code, Some(0), "{name}: {}", ran.err);
            let warned = ran.err.lines().find_map(|line| {
                line.strip_prefix("warning: at ")?.strip_suffix(" s: slave 1 has an alarm, 0x7500: communication")
            });
            let at = warned.unwrap_or_else(|| panic!("{name}: {}", ran.err));
            assert!(at.starts_with(&format!("{begins_s}.00")), "{name}: {at}");
            let file = text(&file);

            let frames = json_lines(&run(["dump", "--json", file]).expect_quiet());
            assert!(frames[0]["time_ns"].as_f64().is_some_and(|ns| ns >= 2.4e9), "{name}: {}", frames[0]);
            assert_eq!(format!("{:.3}", dumped(&frames, "0x7500")), at, "{name}");
            let summary = run(["summary", file]).expect_quiet();
            assert!(summary.contains(&format!("at {at} s: slave 1 has an alarm")), "{name}, {at}: {summary}");
            let found = json_lines(&run(["find", "--json", "alarm(1)", file]).expect_quiet());
            let found_s = found[0]["at_s"].as_f64().expect("a time");
            assert_eq!(format!("{found_s:.3}"), at, "{name}");
            let rule =
                format!("format = 1\n[[events]]\nalarm = 1\nnot_before = \"{begins_s}s\"\nby = \"{begins_s}.01s\"\n");
            fs::write(&rules, rule).expect("a file");
            let judged = run(["assert", file, text(&rules)]).expect_quiet();
            assert!(judged.contains(&format!(": at {at} s")), "{name}, {at}: {judged}");

            let picture = folder.path().join("run.svg");
            run(["plot", file, "--around", at, "-o", text(&picture)]).expect_quiet();
            assert!(fs::read_to_string(&picture).expect("a picture").contains("0x7500"), "{name}");
            // A time outside OP is an error that names the time of OP.
            let outside = run(["plot", file, "--to", "1", "-o", text(&picture)]);
            let op = format!("{:.3} s to ", dumped(&frames, "state OP"));
            assert!(outside.code == Some(1) && outside.err.contains(&op), "{name}, {op}: {}", outside.err);
        }
    }

    /// A recording without the opening of its board, as older versions made them, has its times from its first frame, and
    /// each verb that shows times says so once.
    #[test]
    fn an_old_recording_counts_from_its_first_frame() {
        let folder = tempfile::tempdir().expect("a folder");
        let [script, file] = ["script", "old.pcapng"].map(|name| folder.path().join(name));
        fs::write(&script, "").expect("a file");
        assert_eq!(recorded(&file, &script, &[]).code, Some(0));
        let mut bytes = fs::read(&file).expect("a recording");
        let field = bytes.windows(10).position(|ten| ten == b"opened_ns=").expect("the opening");
        bytes[field] = b'x';
        fs::write(&file, &bytes).expect("a file");
        let picture = folder.path().join("run.svg");
        let file = text(&file);
        for verb in [&["dump", "--json", file][..], &["plot", file, "-o", text(&picture)], &["summary", file]] {
            let ran = run(verb);
            assert_eq!(
                (ran.code, ran.err.matches("times count from its first frame").count()),
                (Some(0), 1),
                "{verb:?}"
            );
            if verb[0] == "dump" {
                assert_eq!(json_lines(&ran.out)[0]["time_ns"], 0);
            }
        }
    }
}
