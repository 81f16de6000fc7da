//! Properties of all verbs: help, version, completions, and outputs that end early.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::process::Stdio;

use crate::common::{Ran, ecmsk, run, run_with_input};

/// `--help` documents the exit codes, every verb has a help of its own, and lines fit a terminal.
#[test]
fn the_help_documents_exit_codes_and_every_verb() {
    let help = run(["--help"]).expect_quiet();
    for code in ["0 ", "1 ", "2 ", "130 ", "143 ", "125 ", "126 ", "127 ", "128 + n"] {
        assert!(help.contains(code), "{code} is missing in {help}");
    }
    for verb in [
        "exec",
        "dump",
        "summary",
        "find",
        "plot",
        "compare",
        "replay",
        "migrate",
        "recording",
        "monitor",
        "info",
        "state",
        "sdo",
        "io",
        "servo",
        "home",
        "move",
        "jog",
        "stop",
        "run",
        "shell",
        "link",
        "list",
        "doctor",
        "completions",
        "man",
    ] {
        assert!(help.contains(&format!("\n  {verb} ")), "{verb} is missing in {help}");
        let about = run([verb, "--help"]).expect_quiet();
        assert!(about.contains(&format!("Usage: ecmsk {verb}")), "{about}");
        assert!(run([verb, "-h"]).expect_quiet().len() <= about.len());
    }
}

/// `--version` prints the version of the cargo package.
#[test]
fn the_version_is_that_of_the_package() {
    assert_eq!(run(["--version"]).expect_quiet(), format!("ecmsk {}\n", env!("CARGO_PKG_VERSION")));
}

/// If a word is the name of a verb in other tools, the error names the verb of this tool; for an unknown word it lists the
/// verbs.
#[test]
fn what_is_looked_for_elsewhere_is_shown() {
    for (words, told) in [
        (&["alarm"][..], "`ecmsk servo clear` resets them"),
        (&["reset", "1"], "`ecmsk servo clear` resets them"),
        (&["scan"], "`ecmsk bus scan` lists the slaves"),
        (&["bus", "scan", "--slaves", "io"], "--link 'sim:?slaves=drive*2'"),
        (&["frobnicate"], "`ecmsk` has the verbs exec, fault, dump, plot, "),
    ] {
        run(words).expect_misuse(&[told]);
        run([words, &["--json"]].concat()).expect_misuse(&[told]);
    }
    run(["dmp"]).expect_misuse(&["a similar subcommand exists: 'dump'"]);
    let named = run(["doctor", "--link", "sim:?slaves=io", "--quick"]);
    assert!(named.out.contains("sim:?slaves=io, from --link"), "{named:?}");
}

/// An address without a port is answered with an example that has one.
#[test]
fn a_port_that_is_missing_is_named() {
    for (verb, port) in [("tcp", 4711), ("usbip", 3240)] {
        let listen = |at| run(["serve", verb, "--link", "sim:?slaves=io", "--listen", at]);
        listen("0.0.0.0").expect_misuse(&[&format!("the port is missing: write 0.0.0.0:{port}")]);
        listen("localhost").expect_misuse(&[&format!("e.g. 127.0.0.1:{port}, or 0.0.0.0:{port}")]);
    }
    let listen = |at| run(["serve", "xf", "--link", "xf-sim:?slaves=io", "--listen", at]);
    for (at, whole) in [("0.0.0.0", "0.0.0.0:4712"), ("::1", "[::1]:4712")] {
        listen(at).expect_misuse(&[&format!("the port is missing: write {whole}")]);
    }
    for at in ["localhost", "unix:", "0.0.0.0:", "4712"] {
        listen(at).expect_misuse(&[at, "neither ADDR:PORT, e.g. 127.0.0.1:4712, nor unix:PATH"]);
    }
}

/// The help of `info` says in which state a board is that nobody has brought up, and how it comes to OP.
#[test]
fn the_help_of_info_names_preop() {
    let help = run(["info", "--help"]).out.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(help.contains("brought to SafeOP or OP is in PreOP"), "{help}");
    assert!(help.contains("--up brings the network to OP first"), "{help}");
}

/// If the recording of `monitor` is missing, the error says so and not that standard output is no terminal. The help of the
/// shell shows the form of a line.
#[test]
fn a_recording_that_is_missing_is_told_first() {
    run(["monitor", "--recording", "nofile"]).expect_failure(1, &["nofile"], "check the path");
    let help = run_with_input(&["shell", "--link", "sim:?slaves=io&clock=virtual"], b"help\n");
    assert!(
        help.out.starts_with("What may be written on a line") && help.out.contains("Usage: VERB [ARGUMENTS]"),
        "{help:?}"
    );
}

/// A wrong command line is reported with the next step, and ends with 2.
#[test]
fn a_wrong_command_line_is_exit_code_2_with_the_next_step() {
    run(["frobnicate"]).expect_misuse(&["frobnicate"]);
    run(["plot"]).expect_misuse(&["<FILE>"]);
    run(["link", "frobnicate"]).expect_misuse(&["frobnicate"]);
    let bare: [&str; 0] = [];
    assert_eq!(run(bare).code, Some(2));
    assert_eq!(run(["link"]).code, Some(2));
}

/// `ecmsk link help` is the library's own table: it has every key that an error may name.
#[test]
fn link_help_lists_every_key_that_an_error_may_name() {
    let help = run(["link", "help"]).expect_quiet();
    assert_eq!(help, ecmsk::link::keys::help());
    for key in ecmsk::link::keys::KEYS {
        assert!(help.contains(&format!("{}=", key.name)), "{} is missing", key.name);
    }
}

/// `ecmsk completions` prints for every shell a script that names the verbs and their options.
#[test]
fn every_shell_gets_completions_of_verbs_and_options() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = run(["completions", shell]).expect_quiet();
        for word in [
            "exec",
            "dump",
            "plot",
            "compare",
            "replay",
            "migrate",
            "monitor",
            "tolerance",
            "slot-size",
            "record",
            "difference",
            "servo",
            "counts-per-unit",
            "write-udev-rule",
            "keep-going",
        ] {
            assert!(script.contains(word), "{shell}: {word} is missing");
        }
    }
    run(["completions", "abacus"]).expect_misuse(&["abacus", "bash"]);
}

/// bash itself accepts the script and completes a verb and an option.
#[test]
#[cfg(target_os = "linux")]
fn completions_work_in_bash() {
    let script = "source \"$1\"; COMP_WORDS=(ecmsk du); COMP_CWORD=1; _ecmsk ecmsk du ecmsk; echo ${COMPREPLY[*]};
        COMP_WORDS=(ecmsk dump --kin); COMP_CWORD=2; _ecmsk ecmsk --kin dump; echo ${COMPREPLY[*]}";
    let folder = tempfile::tempdir().expect("a folder");
    let completions = folder.path().join("completions");
    std::fs::write(&completions, run(["completions", "bash"]).expect_quiet()).expect("a file");
    let bash = std::process::Command::new("bash").args(["-c", script, "bash"]).arg(&completions).output();
    assert_eq!(Ran::from(bash.expect("bash starts")).expect_quiet(), "dump\n--kinds\n");
}

/// If the reader of the output stops (a closed pipe), there is no panic, no message and no failure.
#[test]
fn a_reader_of_the_output_may_stop_without_any_failure() {
    let zeros = format!("{}\n", "00".repeat(504)).repeat(2000);
    for (arguments, input) in [
        (&["dump", "--hex", "--all"][..], zeros.as_str()),
        (&["dump", "--hex", "--json"], &zeros),
        (&["completions", "bash"], ""),
        (&["link", "help"], ""),
        (&["--help"], ""),
        (&["run", "-", "--link", "sim:?slaves=drive&clock=virtual"], &"info\nstate\n".repeat(2000)),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("input");
        std::fs::write(&file, input).expect("a file");
        let mut command = ecmsk(arguments);
        command.stdin(File::open(&file).expect("a file")).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut tool = command.spawn().expect("the tool starts");
        let mut reader = BufReader::with_capacity(16, tool.stdout.take().expect("a pipe"));
        let mut line = Vec::new();
        reader.read_until(b'\n', &mut line).expect("a line");
        drop(reader);
        let mut said = String::new();
        tool.stderr.take().expect("a pipe").read_to_string(&mut said).expect("UTF-8");
        assert_eq!((tool.wait().expect("it ends").code(), said.as_str()), (Some(0), ""), "{arguments:?}");
    }
}

/// A full disk is an error with the next step.
#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_an_error_with_the_next_step() {
    let board = "sim:?slaves=drive&clock=virtual";
    for arguments in [&["link", "help"][..], &["completions", "fish"], &["info", "--link", board]] {
        let full = File::options().write(true).open("/dev/full").expect("Linux has it");
        let ran = Ran::from(ecmsk(arguments).stdout(full).output().expect("the tool starts"));
        ran.expect_failure(1, &["cannot write to standard output", "No space left"], "send it to a place with room");
    }
}

/// A closed standard error changes nothing else about a verb.
#[test]
fn a_closed_standard_error_changes_nothing() {
    let mut command = ecmsk(["dump", "/no/such/file"]);
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    assert_eq!(command.stderr(writer).status().expect("the tool starts").code(), Some(1));
}

/// Nothing is logged unless `ECMSK_LOG` asks.
#[test]
fn nothing_is_logged_unless_asked_for() {
    let zeros = "00".repeat(504);
    assert!(run_with_input(&["dump", "--hex"], &zeros).expect_quiet().contains("GET_STATUS"));
}
