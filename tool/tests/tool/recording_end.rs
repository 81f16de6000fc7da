//! Recordings that were not ended: what each verb that reads one says, and what `exec` and other verbs say about the recordings
//! that they make.
#![cfg(unix)]

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::common::exec::ExecFolder;
use crate::common::{Ran, run};
use serde_json::Value;
use support::recorded::{Program, Run};

/// The recording of a run, cut after its first `frames` frames, as a killed program leaves it.
fn cut_after(run: &Run, frames: usize) -> PathBuf {
    let bytes = fs::read(&run.file).expect("a recording");
    let length = (0..2 + frames)
        .fold(0, |at, _| at + u32::from_le_bytes(bytes[at + 4..at + 8].try_into().expect("four bytes")) as usize);
    let cut = run.file.with_file_name(format!("cut-{frames}.pcapng"));
    fs::write(&cut, &bytes[..length]).expect("a file");
    cut
}

/// A recording that was not ended says so in `dump`, `plot`, `compare`, `replay` and `monitor`, and in their JSON;
/// being equal up to its end is no success, unless that was asked for.
#[test]
fn every_verb_says_that_a_recording_was_not_ended() {
    const SAID: &str = "was not ended";
    let whole = Program::default().record();
    let cut = cut_after(&whole, 900);
    let cut = cut.to_str().expect("UTF-8");
    let svg = whole.file.with_extension("svg");
    for arguments in [
        &["dump", cut][..],
        &["dump", cut, "--json"],
        &["plot", cut, "-o", svg.to_str().expect("UTF-8")],
        &["monitor", "--recording", cut, "--once"],
        &["monitor", "--recording", cut, "--json"],
    ] {
        let ran = run(arguments);
        assert_eq!(ran.code, Some(0), "{arguments:?}: {}", ran.err);
        assert!(ran.err.starts_with("note: ") && ran.err.contains(SAID), "{arguments:?}: {}", ran.err);
        assert_eq!(ran.err.lines().count(), 1, "{arguments:?}: {}", ran.err);
        if arguments.contains(&"--json") {
            let last: Value = serde_json::from_str(ran.out.lines().last().expect("a line")).expect("an object");
            assert!(last.to_string().contains(SAID), "{last}");
        }
        let whole = arguments.iter().map(|word| if *word == cut { whole.path() } else { *word });
        let ran = run(whole);
        assert!(ran.code == Some(0) && ran.err.is_empty() && !ran.out.contains(SAID), "{arguments:?}: {}", ran.err);
    }
    for arguments in [&["compare", cut, cut][..], &["replay", cut]] {
        let ran = run(arguments);
        assert_eq!(ran.code, Some(2), "{}", ran.out);
        assert!(ran.err.contains(SAID) && ran.out.contains("not whole (--allow-incomplete"), "{ran:?}");
        let json = run([arguments, &["--json"]].concat());
        let found: Value = serde_json::from_str(&json.out).expect("an object");
        assert_eq!((json.code, &found["equal"], &found["a"]["whole"]), (Some(2), &false.into(), &false.into()));
        assert!(found["a"]["lacks"].to_string().contains(SAID), "{found}");
        let allowed = run([arguments, &["--allow-incomplete"]].concat());
        assert!(allowed.code == Some(0) && allowed.err.contains(SAID), "{allowed:?}");
    }
    // A difference that is found makes the exit code 1, although the rest of recording B is missing.
    let ran = run(["compare", whole.path(), cut]);
    assert!(ran.code == Some(1) && ran.err.starts_with("note: B: ") && ran.out.contains("B ends early"), "{ran:?}");
}

/// A recording that ends on the way to OP, because the disk was full or the program was killed, does not show that the
/// program gave up.
#[test]
fn a_cut_recording_does_not_show_that_the_program_gave_up() {
    let whole = Program::default().record();
    let dumped = run(["dump", whole.path(), "--slots", "ecm"]).expect_quiet();
    let frames: Vec<&str> = dumped.split("\nframe ").skip(1).collect();
    let asks = frames.iter().position(|frame| frame.contains("SET_STATE OP")).expect("it asks for OP");
    let reached = frames.iter().position(|frame| frame.contains("CYCLIC state OP")).expect("OP");
    assert!(reached > asks + 3, "{asks} {reached}");
    let ran = run(["summary", cut_after(&whole, asks + 3).to_str().expect("UTF-8")]);
    assert!(ran.code == Some(0) && ran.err.contains("was not ended"), "{ran:?}");
    assert!(!ran.out.contains("gave up"), "{}", ran.out);
}

/// A file that was cut after its first command does not show that the model answers as the board did.
#[test]
fn a_recording_cut_after_its_first_command_is_not_replayed_as_equal() {
    let whole = Program::default().record();
    // The first report comes some frames after the first command. Neither a file without a report, nor one with little more
    // than that, shows that the model answers as the board did.
    for frames in [5, 8] {
        let cut = cut_after(&whole, frames);
        let ran = run(["replay", cut.to_str().expect("UTF-8")]);
        assert_eq!(ran.code, Some(2), "{frames}: {ran:?}");
    }
}

/// TOOL-138 `exec` with a program whose recording is not whole: killed, without its end, or on a disk that is full. The
/// message says what is missing; if the program itself ended with 0 the code is 124. An existing recording is not
/// replaced unasked.
#[test]
fn exec_tells_of_its_recording() {
    let place = ExecFolder::new();
    let tool = env!("CARGO_BIN_EXE_ecmsk");
    let file = place.path().join("run.pcapng");
    let options = ["--link", "sim:?slaves=drive&clock=virtual", "--record", "run.pcapng"];
    let moves = format!("{tool} move 1=100000 --up >/dev/null 2>moved");
    place.run(&options, &moves).expect_quiet();
    let whole = fs::read(&file).expect("a recording");
    assert!(whole.len() > 100_000, "{}", whole.len());

    let refused = place.run(&options, "echo started");
    refused.expect_failure(125, &["cannot record to run.pcapng", "is there already", "--overwrite"], "with --record");
    assert!(refused.out.is_empty() && fs::read(&file).expect("a recording") == whole);
    let again = [&options[..], &["--overwrite"]].concat();

    // The disk is full after 64 KiB (`ulimit`): the program succeeds, and its recording is cut there but has an end that says
    // so.
    let full = place.run(&again, &format!("trap '' XFSZ; ulimit -f 128; {moves}; cat moved >&2"));
    assert_eq!(full.code, Some(124), "{full:?}");
    assert!(full.err.contains("has stopped: File too large"), "{}", full.err);
    let last = full.err.lines().last().expect("a line");
    assert!(last.starts_with("warning: ") && last.contains("frames are missing: File too large"), "{last}");
    let dumped = run(["dump", file.to_str().expect("UTF-8"), "--slots", "ecm"]);
    assert!(dumped.code == Some(0) && dumped.err.contains("frames are missing: File too large"), "{}", dumped.err);

    // A recording without its end, as a killed program leaves it. The exit code of a program that has failed is kept.
    let killed = place.run(&again, &format!("{moves}; truncate -s -60 run.pcapng; exit 3"));
    assert!(killed.code == Some(3) && killed.err.contains("was not ended"), "{killed:?}");
    let cut = place.run(&again, &format!("{moves}; truncate -s -52 run.pcapng"));
    assert!(cut.code == Some(124) && cut.err.contains("was not ended"), "{cut:?}");
    // The program has tried to open a board, so nothing was recorded, and `--overwrite` has removed the old recording.
    let nothing = place.run(&again, ":");
    assert!(nothing.code == Some(124) && nothing.err.contains("was not made"), "{nothing:?}");
    assert!(!file.exists());
}

/// A verb for a board, a chip or a network, and a server, that succeed on a full disk say what the recording lacks, and
/// end with 124.
#[test]
fn a_verb_and_a_server_tell_of_their_recording() {
    let place = ExecFolder::new();
    let tool = env!("CARGO_BIN_EXE_ecmsk");
    // The shell limits files to 64 KiB, as if the disk were full after that.
    let run = |script: &str| {
        let script = format!("trap '' XFSZ; ulimit -f 128; {script}");
        Ran::from(Command::new("sh").args(["-c", &script]).current_dir(place.path()).output().expect("sh starts"))
    };
    let board = "sim:?slaves=drive&clock=virtual";
    let moved = run(&format!("{tool} move 1=100000 --up --link '{board}' --record moved.pcapng"));
    assert_eq!((moved.code, moved.out.as_str()), (Some(124), "axis 1: at 100000\n"), "{moved:?}");
    let last = moved.err.lines().last().expect("a line");
    assert!(last.starts_with("error: ") && last.contains("frames are missing: File too large"), "{moved:?}");

    let watched = run(&format!(
        "{tool} monitor --link '{board}&record=watched.pcapng' --json --seconds 1 --interval 10ms >/dev/null"
    ));
    assert_eq!(watched.code, Some(124), "{watched:?}");
    assert!(watched.err.contains("warning: watched.pcapng: "), "{watched:?}");

    for (verb, link) in [("xf scan", "xf-sim:?slaves=drive*3&clock=virtual"), ("bus scan", "xf-sim:?slaves=drive*3")] {
        let file = format!("{}.pcapng", verb.replace(' ', "-"));
        let seen = run(&format!("{tool} {verb} --link '{link}&record={file}'"));
        assert!(seen.code == Some(124) && !seen.out.is_empty(), "{verb}: {seen:?}");
        let last = seen.err.lines().last().expect("a line");
        assert!(
            last.starts_with(&format!("warning: {file}: the recording")) && seen.err.contains("File too large"),
            "{seen:?}"
        );
        let whole = run(&format!("ulimit -f unlimited 2>/dev/null; {tool} {verb} --link '{link}'"));
        assert_eq!(whole.code, Some(0), "{verb}: {whole:?}");
    }

    let served = run(&format!(
        "{tool} serve tcp --listen 127.0.0.1:0 --link '{board}&record=served.pcapng' >said & server=$!
         until address=$(sed -n 's/^listening on \\(.*\\); .*/\\1/p' said) && test \"$address\"; do sleep 0.01; done
         {tool} move 1=100000 --up --link tcp://$address && kill -TERM $server && wait $server"
    ));
    assert_eq!((served.code, served.out.as_str()), (Some(124), "axis 1: at 100000\n"), "{served:?}");
    let last = served.err.lines().last().expect("a line");
    assert!(last.contains("Z warning: ") && last.contains("frames are missing: File too large"), "{served:?}");
}
