//! `ecmsk exec` says why the board did not do what a program wanted, and sums it up; `ecmsk summary` does so of a recording.
#![cfg(target_os = "linux")]

use crate::common::exec::ExecFolder;

/// Each reason is printed once, and the counters at the end, for all processes of the program; unknown lines are
/// skipped. The exit code is the program's.
#[test]
fn what_the_library_tells_is_said_once() {
    let tell =
        |lines: &[&str]| lines.iter().map(|line| format!("echo \"{line}\" >> \"$ECMSK_TOLD\"; ")).collect::<String>();
    let script = tell(&[
        "7 said 0 no board at usb:",
        "8 said 0 no board at usb:",
        "7 new fact of a later build",
        "nonsense",
        "7 said 1 30 more rejected as wrong_state since 1 us; look at the first ones",
        "7 again 0 5",
        "7 alarm 2 29952 1501000000",
        "7 alarm 2 29952 3002000000",
        "7 alarm 3 29952",
        "7 count 0 rejected.wrong_state 10",
        "7 count 0 rejected.wrong_state 30",
        "7 count 1 rejected.wrong_state 1",
        "8 count 0 rejected.no_slave 2",
    ]);
    let script = format!("{script} printf '7 said 2 the begin of a line' >> \"$ECMSK_TOLD\"; exit 6");
    let place = ExecFolder::new();
    let ran = place.run(&[], &script);
    assert_eq!((ran.code, ran.out.as_str()), (Some(6), ""));
    let expected = [
        "warning: no board at usb:",
        "warning: at 1.501 s: slave 2 has an alarm, 0x7500: communication",
        "warning: slave 3 has an alarm, 0x7500: communication",
        "summary: 33 command(s) were rejected and not executed: 31 wrong_state, 2 no_slave",
        "summary: at 1.501 s: slave 2 has an alarm, 0x7500: communication (2 times)",
        "summary: no board at usb: (5 times)",
    ];
    assert_eq!(ran.err.lines().collect::<Vec<_>>(), expected);
    let quiet = place.run(&["--quiet"], &script);
    assert_eq!((quiet.code, quiet.err.as_str()), (Some(6), ""));
    let json = place.run(&["--json"], &script);
    let told: serde_json::Value = serde_json::from_str(&json.err).expect("one object");
    assert_eq!(told["counts"]["rejected.wrong_state"], 31);
    let alarm = &told["alarms"][0];
    assert_eq!((&alarm["error_code"], &alarm["times"], &alarm["at_s"]), (&0x7500.into(), &2.into(), &1.501.into()));
    assert_eq!(told["alarms"][1]["at_s"], serde_json::Value::Null, "a library that does not say when");
    assert_eq!((&told["said"][0]["text"], &told["said"][0]["times"]), (&"no board at usb:".into(), &5.into()));
}

/// Inputs that were not believed, and slaves that were lost for it, are in the summary with their numbers, as text and as
/// JSON.
#[test]
fn stale_inputs_are_in_the_summary() {
    let place = ExecFolder::new();
    let tell = "(echo '7 count 0 inputs_held 37'; echo '7 count 0 inputs_stale 2') >> \"$ECMSK_TOLD\"";
    let ran = place.run(&[], tell);
    let lines: Vec<&str> = ran.err.lines().collect();
    assert_eq!((ran.code, lines.len()), (Some(0), 2), "{}", ran.err);
    assert!(lines[0].starts_with("summary: 37 cycle(s) had a wrong working counter: "), "{}", ran.err);
    assert!(lines[1].starts_with("summary: 2 slave(s) were lost because their inputs did not come, "), "{}", ran.err);
    let json = place.run(&["--json"], tell);
    let told: serde_json::Value = serde_json::from_str(&json.err).expect("one object");
    assert_eq!((&told["counts"]["inputs_held"], &told["counts"]["inputs_stale"]), (&37.into(), &2.into()));
}

/// TOOL-138 An incomplete recording has its own exit code, unless the program has failed anyway.
#[test]
fn a_recording_that_lacks_frames_is_an_exit_code() {
    let place = ExecFolder::new();
    let lacks = "echo '7 count 0 record_dropped 5570' >> \"$ECMSK_TOLD\";";
    let ran = place.run(&[], lacks);
    assert_eq!(ran.code, Some(124), "{}", ran.err);
    assert!(ran.err.starts_with("summary: 5570 frame(s) are missing in the recording; "), "{}", ran.err);
    assert_eq!(place.run(&[], &format!("{lacks} exit 6")).code, Some(6));
}

/// An unread standard error delays neither the program nor the tool.
#[test]
fn a_standard_error_that_nobody_reads_delays_neither_program_nor_tool() {
    use std::io::Write;

    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};

    let (_reader, mut writer) = std::io::pipe().expect("a pipe");
    let flags = fcntl_getfl(&writer).expect("flags");
    fcntl_setfl(&writer, flags | OFlags::NONBLOCK).expect("flags");
    while writer.write(&[b'.'; 1000]).is_ok() {}
    while writer.write(b".").is_ok() {}
    fcntl_setfl(&writer, flags).expect("flags");
    let place = ExecFolder::new();
    let script = ": > \"$ECMSK_OPENED\"; echo '7 said 0 a reason' >> \"$ECMSK_TOLD\"; exit 6";
    let mut command = place.exec(&["--", "sh", "-c", script]);
    let status = command.stderr(writer).status().expect("the tool starts");
    assert_eq!(status.code(), Some(6));
    place.is_clean();
}

/// Programs in C on the library of this build.
mod needs_cxx {
    use std::fs;
    use std::path::{Path, PathBuf};

    use crate::common::{Ran, ecmsk, run};
    use support::{self, Language};

    const TWO: &str = "sim:?slaves=drive*2&clock=virtual";
    const ONE: &str = "sim:?slaves=drive&clock=virtual";

    fn exec(options: &[&str], link: &str, program: &[&str]) -> Ran {
        let exe = support::compile(&support::root().join("tests/c/stream.c"), Language::C("c99")).exe;
        let mut command = ecmsk(["exec", "--library"]);
        command.arg(&support::library().shared).args(options).args(["--link", link, "--"]).arg(exe).args(program);
        command.output().expect("the tool starts").into()
    }

    #[track_caller]
    fn has(ran: &Ran, lines: &[&str]) {
        for line in lines {
            let times = ran.err.lines().filter(|said| said.starts_with(line)).count();
            assert_eq!(times, 1, "`{line}` in\n{}", ran.err);
        }
    }

    /// Nothing is printed for a program whose commands are all executed.
    #[test]
    fn a_program_without_trouble_is_quiet() {
        assert_eq!(exec(&[], TWO, &["2", "300"]).expect_quiet(), "done\n");
    }

    /// Two axes on a network of one: thousands of commands are rejected, which the program does not see. The reason is
    /// printed once, the count at the end; the exit code stays the program's.
    #[test]
    fn rejected_commands_are_told_once_and_counted_at_the_end() {
        let ran = exec(&[], ONE, &["2", "1500"]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), "done\n"));
        has(&ran, &["warning: CSP in slot 2 rejected at ", "warning: SV_ON in slot 2 rejected at "]);
        has(&ran, &["summary: 1501 command(s) were rejected and not executed: 1501 no_slave"]);
        assert_eq!(ran.err.lines().count(), 3, "{}", ran.err);
    }

    /// A program for slots of another size than the board's gets a message.
    #[test]
    fn a_program_for_another_slot_size_is_told_so() {
        let ran = exec(&[], &format!("{TWO}&slot=16"), &["2", "3"]);
        assert_eq!(ran.code, Some(0));
        has(&ran, &["warning: the program writes frames of 504 bytes, the board's are 512 (16-byte slots); "]);
    }

    /// If a program gets no board, `exec` gives the reason: none is plugged in, or another program has it.
    #[test]
    fn why_a_program_got_no_board_is_told() {
        let ran = exec(&[], "tcp://127.0.0.1:9", &["1"]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(3), "no board\n"));
        has(&ran, &["warning: OpenECMUSB() -> link from ECMSK_LINK: no board at `tcp://127.0.0.1:9"]);
        assert_eq!(ran.err.lines().count(), 1, "what was said once is not said again: {}", ran.err);
        let ran = exec(&[], "sim:?slaves=nonsense", &["1"]);
        assert_eq!(ran.code, Some(2), "a wrong link is a wrong command line: {}", ran.err);
    }

    /// TOOL-158 State 0x12 is explained: no axes were declared, or a slave refuses.
    #[test]
    fn why_a_change_of_state_failed_is_told() {
        let ran = exec(&[], TWO, &["2", "10", "undeclared"]);
        assert_eq!(ran.code, Some(0));
        let failed = "warning: a change of state failed, byte 2 of slot 0 is 0x12: PreOP (a slave failed); ";
        has(&ran, &[&format!("{failed}the program has declared no drive by SET_AXIS")]);
        let folder = tempfile::tempdir().expect("a folder");
        let script = folder.path().join("refuses");
        fs::write(&script, "refuse 2 safeop\n").expect("a file");
        let ran = exec(&[], &format!("{TWO}&script={}", script.display()), &["2", "0"]);
        has(&ran, &[&format!("{failed}see whether SET_AXIS declares each slave")]);
    }

    /// `exec` reports a full FIFO, a FIFO that runs empty in a motion, and reports that the program did not read.
    #[test]
    fn a_full_fifo_an_empty_fifo_and_unread_reports_are_told() {
        let ran = exec(&[], TWO, &["2", "500", "flood"]);
        has(&ran, &["warning: since ", "summary: 278 command frame(s) found the FIFO full and were lost; "]);
        let ran = exec(&[], TWO, &["2", "200", "gap"]);
        has(&ran, &["summary: 1 gap(s) in a motion: "]);
        assert_eq!(ran.err.lines().count(), 1, "{}", ran.err);
    }

    /// `exec` prints a summary also for a program that is killed.
    #[test]
    fn a_program_that_is_killed() {
        let ran = exec(&[], ONE, &["2", "200", "killed"]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(137), "done\n"));
        has(&ran, &["summary: 201 command(s) were rejected and not executed: 201 no_slave"]);
    }

    fn recorded(folder: &Path, link: &str, program: &[&str]) -> (Ran, PathBuf) {
        let file = folder.join("run.pcapng");
        let ran = exec(&["--overwrite", "--record", file.to_str().expect("UTF-8")], link, program);
        (ran, file)
    }

    /// `summary` prints for a recording what `exec` printed for the program, as far as frames show it.
    #[test]
    fn the_summary_of_a_recording() {
        let folder = tempfile::tempdir().expect("a folder");
        let script = folder.path().join("alarm");
        fs::write(&script, "at 800ms alarm 1 0x7500\nat 850ms alarm 2 0x2310\n").expect("a file");
        let link = format!("{TWO}&script={}", script.display());
        let (ran, file) = recorded(folder.path(), &link, &["2", "400", "gap"]);
        assert_eq!(ran.code, Some(0));
        // The script lets them begin at 800 ms and 850 ms, and the next report shows them.
        let alarms = [
            "at 0.801 s: slave 1 has an alarm, 0x7500: communication",
            "at 0.851 s: slave 2 has an alarm, 0x2310: continuous overcurrent at the output",
        ];
        alarms.iter().for_each(|alarm| has(&ran, &[&format!("warning: {alarm}")]));
        // Warnings have the times of the script, which count from the opening of the board. `dump` shows the alarm at the same
        // time, since the recording begins at once.
        has(&ran, &["warning: script, line 1: `alarm 1 0x7500` at 0.800 s"]);
        let dump = run(["dump", "--from", "799ms", "--to", "803ms", file.to_str().expect("UTF-8")]).expect_quiet();
        let shown = dump.find("Fault reaction active").expect("the alarm");
        assert!(dump[..shown].contains(" 0.80"), "{dump}");
        let text = run(["summary", file.to_str().expect("UTF-8")]).expect_quiet();
        let gap = "1 gap(s) in a motion: ";
        has(&ran, &[&format!("summary: {gap}")]);
        assert!(text.starts_with(gap) && text.contains(&format!("{}\n{}\naxis 1: ", alarms[0], alarms[1])), "{text}");
        let json = run(["summary", "--json", file.to_str().expect("UTF-8")]).expect_quiet();
        let json: serde_json::Value = serde_json::from_str(&json).expect("one object");
        assert_eq!(json["counts"], serde_json::json!({"gaps": 1}));
        assert_eq!(json["alarms"][1]["error_code"], 0x2310);
        assert_eq!(json["alarms"][1]["at_s"], 0.851);

        let (_, file) = recorded(folder.path(), TWO, &["2", "500", "flood"]);
        let text = run(["summary", file.to_str().expect("UTF-8")]).expect_quiet();
        assert!(text.starts_with("278 command frame(s) found the FIFO full and were lost; "), "{text}");
        let (_, file) = recorded(folder.path(), TWO, &["2", "10", "undeclared"]);
        let text = run(["summary", file.to_str().expect("UTF-8")]).expect_quiet();
        assert!(
            text.starts_with("a change of state failed, byte 2 of slot 0 is 0x12: PreOP (a slave failed); the program"),
            "{text}"
        );
        assert_eq!(run(["summary", "--exit-code", file.to_str().expect("UTF-8")]).code, Some(1));
        let (_, file) = recorded(folder.path(), TWO, &["2", "100"]);
        let text = run(["summary", "--exit-code", file.to_str().expect("UTF-8")]).expect_quiet();
        assert!(text.starts_with("axis 1: following error up to ") && text.lines().count() == 2, "{text}");
        let whole = fs::read(&file).expect("it is there");
        fs::write(&file, &whole[..whole.len() - 3]).expect("a file");
        assert_eq!(run(["summary", "--exit-code", file.to_str().expect("UTF-8")]).code, Some(1));

        // The program gives up before the board is in SafeOP. With `hasty_and_tidy` it sends SET_STATE Init before it ends.
        for how in ["hasty", "hasty_and_tidy"] {
            let (ran, file) = recorded(folder.path(), TWO, &["2", "0", how]);
            let hasty = "the program gave up 4 ms after it had asked for OP, while the board was on its way there; ";
            has(&ran, &[&format!("summary: {hasty}")]);
            let text = run(["summary", file.to_str().expect("UTF-8")]).expect_quiet();
            assert!(text.starts_with(hasty), "{how}: {text}");
        }
    }

    /// TOOL-138 A disk that is full while a program is recorded gives a message and an exit code.
    #[test]
    fn a_full_disk_while_recording_is_told_and_is_an_exit_code() {
        let ran = exec(&["--record", "/dev/full"], TWO, &["2", "500"]);
        assert!(matches!(ran.code, Some(124 | 3)), "{:?}: {}", ran.code, ran.err);
        assert!(ran.err.contains("/dev/full") || ran.err.contains("missing in the recording"), "{}", ran.err);
    }
}
