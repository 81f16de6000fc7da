//! `ecmsk exec`: the environment of a program, and the result of its end. Shell scripts take the place of programs
//! here; programs on the real library are in the module `needs_cxx`. `exec_library.rs` tests which library they get.
#![cfg(target_os = "linux")]

use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::common::exec::{ExecFolder, OPEN_BOARD};
use crate::common::{Ran, with_default_signals};
use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::LinkUri;
use support::pe::{IL_ONLY, Pe, X64};

/// The program gets the link in normal form, and nothing is printed.
#[test]
fn the_link_reaches_the_program() {
    let place = ExecFolder::new();
    let link = "sim:?clock=virtual&slaves=drive,drive,drive&slot=12";
    let out = place.run(&["--link", link], "echo \"$ECMSK_LINK\"").expect_quiet();
    assert_eq!(out, "sim:?slaves=drive*3&clock=virtual\n");
    let out = place.run(&["--link", "xf-sim:?ahead=5&slaves=io"], "echo \"$ECMSK_LINK\"").expect_quiet();
    assert_eq!(out, "xf-sim:?slaves=io&ahead=5\n");
}

/// Without --link the library searches its link as usual: the variable is neither set nor removed.
#[test]
fn without_a_link_the_environment_stays() {
    let place = ExecFolder::new();
    assert_eq!(place.run(&[], "echo \"${ECMSK_LINK-not set}\"").expect_quiet(), "not set\n");
    let script = ["--", "sh", "-c", &format!("{OPEN_BOARD} echo \"$ECMSK_LINK\"")];
    let mut command = place.exec(&[]);
    let ran = Ran::from(command.args(script).env("ECMSK_LINK", "anything").output().expect("the tool starts"));
    assert_eq!(ran.expect_quiet(), "anything\n");
}

/// A program that never used the library is reported, with or without a link; the exit code is its own.
#[test]
fn a_program_that_opens_no_board_is_named() {
    let place = ExecFolder::new();
    for options in [&[] as &[&str], &["--link", "sim:"]] {
        let ran = Ran::from(place.exec(options).args(["--", "sh", "-c", "exit 3"]).output().expect("the tool starts"));
        assert_eq!(ran.code, Some(3));
        assert!(ran.err.starts_with("note: sh has opened no board; ") && ran.err.contains("ldd"), "{}", ran.err);
        assert_eq!(ran.err.lines().count(), 1, "{}", ran.err);
    }
}

/// `--record` becomes the key `record=` of the link, percent-encoded and with the absolute path.
#[test]
fn record_is_part_of_the_link() {
    let place = ExecFolder::new();
    let name = "a run & 100 %?#=.pcapng";
    let out = place
        .run(&["--link", "sim:?clock=virtual", "--record", name], &format!("mkfifo '{name}'; echo \"$ECMSK_LINK\""));
    let out = out.expect_quiet();
    let link = LinkUri::parse(out.trim_end()).expect("a link");
    let expected = fs::canonicalize(place.path()).expect("a folder").join(name);
    assert_eq!(link.value("record").map(Path::new), Some(expected.as_path()));
    assert_eq!(link.value("clock"), Some("virtual"));
}

/// A recording that the program did not make, because it has opened another board, or none, is missing, and a program that
/// succeeded does not pass for one that was recorded.
#[test]
fn a_recording_that_was_not_made_is_missing() {
    let place = ExecFolder::new();
    for (script, code) in [("true", 124), ("exit 3", 3)] {
        let ran = place.run(&["--link", "sim:", "--record", "run.pcapng"], script);
        assert_eq!(ran.code, Some(code), "{ran:?}");
        assert!(ran.err.starts_with("warning: run.pcapng was not made: "), "{}", ran.err);
    }
}

/// A recording that cannot be made is an error before the program starts.
#[test]
fn a_recording_that_cannot_be_made_is_an_error_before_the_program_starts() {
    let place = ExecFolder::new();
    let refused = |record: &str, code, words: &[&str], next: &str| {
        let ran = place.run(&["--link", "sim:", "--record", record], "echo started");
        ran.expect_failure(code, words, next);
        assert_eq!(ran.out, "", "the program was started");
    };
    refused("nowhere/run.pcapng", 125, &["nowhere/run.pcapng", "its folder does not exist"], "with --record");
    refused("tmp", 125, &["cannot record to tmp", "it is a folder"], "with --record");
    let twice = place.run(&["--link", "sim:?record=a", "--record", "b"], "echo started");
    twice.expect_failure(2, &["`record` is given twice"], "ecmsk link help");
}

/// Without --link `--record` records the link that the library would choose: that of ECMSK_LINK, else that of a file beside the
/// program, else that of a file beside the library, else a board on USB.
#[test]
fn without_a_link_the_recording_is_of_the_link_that_the_library_chooses() {
    let place = ExecFolder::new();
    let nowhere = place.tmp();
    let run = |variable: Option<&str>| {
        let mut command = place.exec(&["--record", "run.pcapng", "--", "./program"]);
        command.env("HOME", &nowhere).env("XDG_CONFIG_HOME", &nowhere).env_remove("ECMSK_LINK");
        if let Some(link) = variable {
            command.env("ECMSK_LINK", link);
        }
        Ran::from(command.output().expect("the tool starts"))
    };
    place.program(
        "program",
        "#!/bin/sh\n: > \"$ECMSK_OPENED\"; [ -e run.pcapng ] || mkfifo run.pcapng; echo \"$ECMSK_LINK\"\n",
        "755",
    );
    let record = LinkUri::parse(run(None).expect_quiet().trim_end()).expect("a link");
    assert!(record.scheme() == Scheme::Usb && record.value("record").is_some(), "{record}");
    let record = LinkUri::parse(run(Some("sim:?slot=16")).expect_quiet().trim_end()).expect("a link");
    let expected = fs::canonicalize(place.path()).expect("a folder").join("run.pcapng");
    assert_eq!((record.value("slot"), record.value("record").map(Path::new)), (Some("16"), Some(expected.as_path())));
    run(Some("sim:?slot=14")).expect_failure(2, &["`slot` does not take `14`"], "ecmsk link help");
    let file = place.path().join("ecmsk.toml");
    fs::write(&file, "link = \"sim:?slaves=drive*5\"\n").expect("a file");
    let record = LinkUri::parse(run(None).expect_quiet().trim_end()).expect("a link");
    assert_eq!(record.value("slaves"), Some("drive*5"));
    fs::write(&file, "lnk = 1\n").expect("a file");
    run(None).expect_failure(125, &["ecmsk.toml, line 1"], "ecmsk link help");
}

/// A wrong link is an error of the command line, and the program is not started.
#[test]
fn a_wrong_link_does_not_start_the_program() {
    let place = ExecFolder::new();
    for (link, words) in [
        ("sim:?slavs=drive", ["slavs", "slaves"]),
        ("sim:?slaves=drive*41", ["drive*41", "40"]),
        ("bus:", ["unknown scheme `bus`", "sim:"]),
        ("can:eth1", ["unknown scheme `can`", "sim:?slaves=drive*2"]),
    ] {
        let ran = place.run(&["--link", link], "echo started");
        ran.expect_misuse(&words);
        assert_eq!(ran.out, "", "{link}: the program was started");
    }
}

/// The tool ends with the program's exit code; 128 + n if signal n ended it.
#[test]
fn the_exit_code_is_that_of_the_program_or_128_plus_the_signal() {
    let place = ExecFolder::new();
    for code in [0, 1, 3, 125, 255] {
        let ran = place.run(&[], &format!("exit {code}"));
        assert_eq!((ran.code, ran.err.as_str()), (Some(code), ""));
    }
    for (signal, code) in [("KILL", 137), ("TERM", 143), ("SEGV", 139)] {
        let ran = place.run(&[], &format!("kill -{signal} $$"));
        assert_eq!((ran.code, ran.err.as_str()), (Some(code), ""), "{signal}");
    }
}

/// The exit code is 127 for a program that does not exist and 126 for one that cannot be executed; the error says what to do.
#[test]
fn programs_that_do_not_start() {
    let place = ExecFolder::new();
    place.program("program", "#!/bin/sh\n", "644");
    place.program("script", "#!/no/such/shell\n", "755");
    place.program("rubbish", "\x01\x02\x03", "755");
    let run = |program: &str| {
        let ran = Ran::from(place.exec(&["--"]).arg(program).output().expect("the tool starts"));
        place.is_clean();
        ran
    };
    run("no-such-program").expect_failure(127, &["no-such-program: not found"], "put its folder on PATH");
    run("./no-such-program").expect_failure(127, &["./no-such-program: not found"], "check the path");
    run("program").expect_failure(127, &["program: not found"], "write ./program");
    run("./program").expect_failure(126, &["./program: Permission denied"], "chmod +x");
    place.program("main.cpp", "int main() {}\n", "644");
    run("./main.cpp").expect_failure(126, &["it is a source: compile it, g++ ./main.cpp"], "docs/GUIDE-CPP.md");
    place.program("read.py", "print(1)\n", "755");
    run("./read.py").expect_failure(126, &["./read.py: Exec format error"], "-- python3 ./read.py");
    place.program("press.exe", Pe::program(X64).bytes(), "644");
    run("./press.exe").expect_failure(126, &["it is a program of Windows"], "docs/WINDOWS.md");
    place.program("managed.exe", Pe::program(X64).managed(IL_ONLY).bytes(), "644");
    run("./managed.exe").expect_failure(126, &["it is a .NET program"], "-- mono ./managed.exe (docs/DOTNET.md)");
    run("/").expect_failure(126, &["/: Permission denied"], "name the program in it");
    run("./script").expect_failure(127, &["./script: not found"], "its interpreter or dynamic linker is not");
    run("./rubbish").expect_failure(126, &["./rubbish: Exec format error"], "build it here");
}

/// Options behind the program belong to the program, with or without `--`.
#[test]
fn arguments_are_passed_on() {
    let place = ExecFolder::new();
    for between in [&["--"][..], &[]] {
        let mut command = place.exec(&["-v"]);
        command.args(between).args(["printf", "%s|", "--link", "x y", "-v", "--help"]);
        let ran = Ran::from(command.output().expect("the tool starts"));
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), "--link|x y|-v|--help|"));
    }
    let nothing = Ran::from(place.exec(&[]).output().expect("the tool starts"));
    nothing.expect_misuse(&["<PROGRAM>"]);
}

/// -v prints the variables that were set and how the program ended, on standard error alone.
#[test]
fn verbose_says_what_was_set_and_how_the_program_ended() {
    let place = ExecFolder::new();
    let ran = place.run(&["-v", "--link", "sim:"], "echo out; exit 3");
    assert_eq!((ran.code, ran.out.as_str()), (Some(3), "out\n"));
    let library = place.path().join("libNEXTWUSBLib.so");
    for line in [format!("library: {}", library.display()), "ECMSK_LINK: sim:".into(), "program: exit status: 3".into()]
    {
        assert!(ran.err.lines().any(|said| said == line), "`{line}` is missing in: {}", ran.err);
    }
    assert!(ran.err.contains(&format!("LD_LIBRARY_PATH: {}", place.tmp().display())), "{}", ran.err);
}

/// A folder for temporary files that cannot be used is named.
#[test]
fn a_folder_for_temporary_files_that_cannot_be_used_is_named() {
    let place = ExecFolder::new();
    let run = |tmp: &Path| {
        let mut command = place.exec(&["--", "true"]);
        Ran::from(command.env("TMPDIR", tmp).output().expect("the tool starts"))
    };
    let gone = place.path().join("gone");
    run(&gone).expect_failure(125, &["cannot make a folder", "gone"], "set TMPDIR");
    let colon = place.path().join("a:b");
    fs::create_dir(&colon).expect("a folder");
    run(&colon).expect_failure(125, &["cannot look into", "a:b"], "set TMPDIR");
}

/// A program inherits no ignored or blocked signal from the tool, and what the user ignores (`nohup`) stays ignored.
#[test]
fn signals_are_inherited_as_they_were() {
    let place = ExecFolder::new();
    let script = ["--", "sh", "-c", ": > \"$ECMSK_OPENED\"; cat /proc/self/status"];
    // Only the signals 1 to 31 are compared. The C library uses some of the others for itself.
    let mask = |status: &str, name: &str| {
        let mask = status.lines().find_map(|line| line.strip_prefix(name)).expect("a line");
        u64::from_str_radix(mask.trim(), 16).expect("a mask") & 0x7FFF_FFFF
    };
    // Processes inherit the signals that are ignored here. SIGPIPE is an exception: Rust ignores it in its own programs, but
    // not in programs that these start.
    let own = fs::read_to_string("/proc/self/status").expect("a file");
    let ignored = mask(&own, "SigIgn:") & !(1 << 12);
    let out = Ran::from(place.exec(&script).output().expect("the tool starts")).expect_quiet();
    assert_eq!((mask(&out, "SigBlk:"), mask(&out, "SigIgn:")), (0, ignored));

    let inner = place.exec(&script);
    let mut nohup = Command::new("sh");
    nohup.args(["-c", "trap '' HUP INT; exec \"$@\"", "sh"]).arg(inner.get_program()).args(inner.get_args());
    let ran = Ran::from(nohup.env("TMPDIR", place.tmp()).output().expect("the shell starts"));
    assert_eq!(mask(&ran.expect_quiet(), "SigIgn:"), ignored | 0b11);
}

/// Starts `ecmsk exec` with a shell script in a process group of its own, as a shell does. Returns the tool once the script has
/// printed `ready`.
fn start(place: &ExecFolder, script: &str) -> Child {
    let mut command = with_default_signals(&place.exec(&["--", "sh", "-c", script]));
    let mut tool = command.stdout(Stdio::piped()).process_group(0).spawn().expect("the tool starts");
    let mut line = String::new();
    BufReader::new(tool.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
    assert_eq!(line, "ready\n");
    tool
}

/// Sends a signal to a process, or to a process group if `whom` is its number with a minus.
fn kill(signal: &str, whom: &str) {
    let sent = Command::new("kill").args([signal, "--", whom]).status().expect("kill starts");
    assert!(sent.success(), "kill {signal} {whom}");
}

/// Ctrl-C reaches the program and the tool, which are in the same process group. The program decides what to do, and the tool
/// ends with it.
#[test]
fn ctrl_c_is_handled_by_the_program_alone() {
    let place = ExecFolder::new();
    for (script, code) in [
        ("trap 'exit 9' INT; echo ready; while :; do sleep 0.05; done", 9),
        ("echo ready; exec sleep 300", 130),
        ("trap '' INT; echo ready; sleep 0.3; exit 4", 4),
    ] {
        let mut tool = start(&place, script);
        kill("-INT", &format!("-{}", tool.id()));
        assert_eq!(tool.wait().expect("it ends").code(), Some(code), "{script}");
        place.is_clean();
    }
}

/// SIGTERM and SIGHUP that come to the tool alone are passed on.
#[test]
fn sigterm_and_sighup_are_passed_on_to_the_program() {
    let place = ExecFolder::new();
    for (signal, script, code) in [
        ("-TERM", "trap 'exit 7' TERM; echo ready; while :; do sleep 0.05; done", 7),
        ("-TERM", "echo ready; exec sleep 300", 143),
        ("-HUP", "echo ready; exec sleep 300", 129),
    ] {
        let mut tool = start(&place, script);
        kill(signal, &tool.id().to_string());
        assert_eq!(tool.wait().expect("it ends").code(), Some(code), "{script}");
        place.is_clean();
    }
}

/// Programs in C on the library of this build.
mod needs_cxx {
    use super::*;
    use crate::common::{Ran, ecmsk, run};
    use support::{self, Language};

    fn program(name: &str) -> PathBuf {
        support::compile(&support::root().join("tests/c").join(name), Language::C("c99")).exe
    }

    fn exec(options: &[&str], program: &Path) -> Ran {
        exec_command(options, program).output().expect("the tool starts").into()
    }

    fn exec_command(options: &[&str], program: &Path) -> Command {
        let mut command = ecmsk(["exec", "--library"]);
        let nowhere = support::out_dir().join("no-configuration");
        command.arg(&support::library().shared).args(options).arg("--").arg(program);
        command.env("HOME", &nowhere).env("XDG_CONFIG_HOME", &nowhere);
        command
    }

    /// LIB-1 A program that links the library runs on the board that the tool names.
    #[test]
    fn a_program_runs_on_the_board_named() {
        let out = exec(&["--link", "sim:?slaves=drive*3&clock=virtual"], &program("which_link.c")).expect_quiet();
        assert_eq!(out, "sim:?slaves=drive*3&clock=virtual\n");
    }

    /// Without --link the library opens its default link, a board on USB.
    #[test]
    fn without_a_link_the_library_decides() {
        let mut command = exec_command(&[], &program("which_link.c"));
        // The test must not use a board that is plugged in here.
        support::without_libusb(&mut command);
        let ran = Ran::from(command.output().expect("the tool starts"));
        assert_eq!(ran.code, Some(1));
        assert!(ran.err.starts_with("warning: OpenECMUSB() -> link by default: no board at `usb:`"), "{}", ran.err);
        assert!(ran.out.contains("usb:") && ran.err.lines().count() == 1, "{}{}", ran.out, ran.err);
    }

    /// A configuration beside the library is found, though the library is loaded from another folder.
    #[test]
    fn the_configuration_beside_the_library_counts() {
        let folder = tempfile::tempdir().expect("a folder");
        fs::copy(&support::library().shared, folder.path().join("libNEXTWUSBLib.so")).expect("a copy");
        fs::write(folder.path().join("ecmsk.toml"), "link = \"sim:?slaves=drive*7&clock=virtual\"").expect("a file");
        let mut command = ecmsk(["exec", "--library"]);
        command.arg(folder.path()).arg("--").arg(program("which_link.c"));
        let ran = Ran::from(command.output().expect("the tool starts"));
        assert_eq!(ran.expect_quiet(), "sim:?slaves=drive*7&clock=virtual\n");
    }

    /// A program's recording can be read and plotted afterwards.
    #[test]
    fn a_program_is_recorded() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("two axes.pcapng");
        let path = file.to_str().expect("UTF-8");
        let link = "sim:?slaves=drive*2&clock=virtual";
        let out = exec(&["--link", link, "--record", path], &program("two_axes.c")).expect_quiet();
        assert_eq!(out, "ok\n");
        let text = run(["dump", path]).expect_quiet();
        assert!(text.starts_with("# sim:?clock=virtual\n"), "{}", &text[..200]);
        for line in ["SET_STATE OP", "slave 2  CSP target -50000", "slave 1  CSP DRIVE statusword", "position 100000,"]
        {
            assert!(text.contains(line), "`{line}` is missing");
        }
        let plot = folder.path().join("two axes.svg");
        assert_eq!(run(["plot", path]).expect_quiet(), format!("{}\n", plot.display()));
        let svg = fs::read_to_string(plot).expect("a plot");
        assert!(svg.contains("Axis 1: position (counts)") && svg.contains("Axis 2: position (counts)"));
    }

    /// A target of a program beyond a limit of the machine file is a warning with axis, target, limit and time, and is in the
    /// summary. If the file says so, it is not sent.
    #[test]
    fn a_target_beyond_a_limit_is_a_warning() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("machine.toml");
        let path = file.to_str().expect("UTF-8");
        let machine = "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.001, max = 50 }\n\
                       Y = { slave = 2, unit = \"mm\", per = 0.001, min = -20 }\n";
        let link = "sim:?slaves=drive*2&clock=virtual";
        let run = |text: &str, options: &[&str]| {
            fs::write(&file, text).expect("a file");
            exec(&[&["--link", link, "--machine", path], options].concat(), &program("two_axes.c"))
        };
        let ran = run(machine, &[]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), "ok\n"), "{ran:?}");
        for (axis, limit) in [("X", "max = 50 mm"), ("Y", "min = -20 mm")] {
            let told = |line: &&str| line.contains(&format!("axis {axis}: a target of ")) && line.contains(limit);
            assert_eq!(ran.err.lines().filter(told).count(), 1, "{ran:?}");
        }
        let json = run(machine, &["--json"]);
        let told: serde_json::Value = serde_json::from_str(&json.err).expect("one object");
        assert_eq!(told["said"].as_array().map(Vec::len), Some(2), "{told}");
        let ran = run(&format!("{machine}[limits]\nprogram = \"stop\"\n"), &[]);
        assert!(ran.code != Some(0) && ran.err.contains("; it is not sent"), "{ran:?}");
    }
}
