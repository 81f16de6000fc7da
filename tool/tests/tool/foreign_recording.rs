//! Recordings of unknown origin: their texts do not control a terminal, open no file, and every verb ends.
#![cfg(unix)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use crate::common::{Ran, json_lines, run};
use ecmsk::link::Link;
use ecmsk::link::options::Clock;
use ecmsk::link::record::RecordLink;
use ecmsk::recording::{RecordMeta, Recording};
use support::recorded::Program;
use support::recording::{Echo, Memory};

/// Control sequences that change a terminal's title, clear it, colour it, and overwrite text.
const CONTROLS: &str = "\u{1b}]0;owned\u{7}\u{1b}[2J\u{9b}31m\rover\u{8}\u{7f}\u{202e}";

#[track_caller]
fn harmless(ran: &Ran) {
    for (what, text) in [("output", &ran.out), ("error", &ran.err)] {
        let odd =
            text.chars().find(|letter| letter.is_control() && !matches!(letter, '\n' | '\t') || *letter == '\u{202e}');
        assert_eq!(odd, None, "{what}: {text:?}");
    }
}

/// Copies a recording to `file`, but with `link` as the link that it names.
fn renamed(recording: &Path, link: &str, file: &Path) {
    let memory = Memory::default();
    let meta = RecordMeta {
        slot: None,
        clock: Clock::Virtual,
        base_ns: 0,
        opened_ns: None,
        link: link.to_owned(),
        machine: None,
    };
    RecordLink::to_sink(Arc::new(Echo::new(true)), "m", Box::new(memory.clone()), &meta, 1).expect("memory").close();
    let mut bytes = memory.bytes();
    // A recording with the wanted link gives the section header and the interface block, the recording to copy gives all frames
    // and the end.
    let second = |bytes: &[u8]| (0..2).fold(0, |at, _| at + support::recording::u32_at(bytes, at + 4) as usize);
    bytes.truncate(second(&bytes));
    let whole = fs::read(recording).expect("a recording");
    bytes.extend(&whole[second(&whole)..]);
    fs::write(file, bytes).expect("a file");
}

/// Control sequences in the texts of a recording and in the name of its file are shown as codes: in text, in errors and notes,
/// in pictures. JSON has the texts unchanged.
#[test]
fn text_of_a_recording_is_shown() {
    let program = Program::default().record();
    let folder = program.file.with_file_name(format!("{CONTROLS} folder"));
    fs::create_dir(&folder).expect("a folder");
    let link = format!("sim:?slaves=drive*2,io&clock=virtual&name={CONTROLS}");
    let file = folder.join("run.pcapng");
    renamed(&program.file, &link, &file);
    let file = file.to_str().expect("UTF-8");
    let svg = folder.join("plot.svg");
    for arguments in [
        &["dump", file, "--slots", "ecm"][..],
        &["dump", file, "--json"],
        &["dump", file, "--slots", "99"],
        &["plot", file],
        &["plot", file, "-o", svg.to_str().expect("UTF-8")],
        &["plot", file, "-o", "-"],
        &["compare", file, file],
        &["compare", file, program.path(), "--json"],
        &["compare", file, CONTROLS],
        &["replay", file],
        &["replay", file, "--json"],
        &["migrate", file],
        &["migrate", file, "--json"],
        &["monitor", "--recording", file, "--once"],
        &["monitor", "--recording", file, "--json"],
        &["exec", "--record", file, "--link", "sim:", "--", CONTROLS],
    ] {
        let ran = run(arguments);
        harmless(&ran);
        if arguments.contains(&"--json") {
            let parsed = json_lines(&ran.out);
            let named = parsed.iter().any(|object| object["name"] == file || object["a"]["file"] == file);
            assert!(named || !matches!(arguments[0], "compare" | "monitor"), "{}", ran.out);
        }
    }
    let plot = fs::read_to_string(&svg).expect("a picture");
    assert!(!plot.chars().any(|letter| letter.is_control() && letter != '\n'), "{plot:?}");
    let shown = run(["dump", file, "--slots", "ecm"]).out;
    assert!(shown.contains("\\u001b]0;owned\\u0007"), "{}", shown.lines().next().expect("a line"));
}

/// A copy of a recording called `name`, with changed times: `change` gets the number of each frame from 0 and its time in
/// nanoseconds, and returns the new time.
fn with_times(recording: &Path, name: &str, change: impl Fn(usize, u64) -> u64) -> PathBuf {
    let mut bytes = fs::read(recording).expect("a recording");
    let (mut at, mut frame) = (0, 0);
    while at < bytes.len() {
        let (kind, length) =
            (support::recording::u32_at(&bytes, at), support::recording::u32_at(&bytes, at + 4) as usize);
        if kind == 6 {
            let half = |at| u64::from(support::recording::u32_at(&bytes, at));
            let time = change(frame, (half(at + 12) << 32) | half(at + 16));
            bytes[at + 12..at + 16].copy_from_slice(&((time >> 32) as u32).to_le_bytes());
            bytes[at + 16..at + 20].copy_from_slice(&(time as u32).to_le_bytes());
            frame += 1;
        }
        at += length;
    }
    let file = recording.with_file_name(name);
    fs::write(&file, bytes).expect("a file");
    file
}

/// An inverted bit in the time of a frame, and a clock that was set, are reported and do not count as elapsed time:
/// `replay` ends, and the model answers as before.
#[test]
fn replay_ends_whatever_the_times_are() {
    let program = Program { short: true, ..Program::default() }.record();
    let frames = Recording::open(&program.file).expect("a recording").count();
    for (frame, bit) in [(3, 63), (frames / 2, 62), (frames / 2, 43), (frames / 3, 34), (frames - 2, 50)] {
        let file = with_times(&program.file, "flipped.pcapng", |n, at| if n == frame { at ^ (1 << bit) } else { at });
        let ran = run(["replay", file.to_str().expect("UTF-8")]);
        assert!(ran.err.contains("its times jump once"), "{frame} {bit}: {}", ran.err);
        assert!(ran.code == Some(0) && ran.out.contains("\nequal: "), "{frame} {bit}: {}", ran.out);
    }
    // The clock is set back by an hour in the middle of the motion: there is no idle time in between.
    let back =
        with_times(&program.file, "back.pcapng", |n, at| at + if n < frames / 2 { 3_600_000_000_000 } else { 0 });
    // The opening of the board is left out: its time is that of a clock which was not set.
    let mut bytes = fs::read(&back).expect("a recording");
    let field = bytes.windows(10).position(|ten| ten == b"opened_ns=").expect("the opening");
    bytes[field] = b'x';
    fs::write(&back, bytes).expect("a file");
    let ran = run(["replay", back.to_str().expect("UTF-8")]);
    assert!(ran.err.contains("its times jump once"), "{}", ran.err);
    assert!(ran.out.starts_with("A is "), "{ran:?}");
    // The plot shows the time of the motion, and not the hour by which the clock was set.
    let svg = program.file.with_extension("svg");
    let ran = run(["plot", back.to_str().expect("UTF-8"), "-o", svg.to_str().expect("UTF-8")]);
    assert!(ran.code == Some(0) && ran.err.contains("its times jump once"), "{ran:?}");
    let text = fs::read_to_string(&svg).expect("a picture");
    let about = text.lines().find(|line| line.contains(" frames")).expect("what it is of");
    assert!(about.contains("0.") && !about.contains("600"), "{about}");
}

/// Files that a recording's link names are not opened unasked: a pipe without a writer would wait, a file of the system
/// would be shown.
#[test]
fn replay_opens_no_file_unasked() {
    let program = Program { short: true, ..Program::default() }.record();
    let pipe = program.file.with_file_name("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo starts").success());
    let file = program.file.with_file_name("named.pcapng");
    for named in [
        format!("script={}", pipe.display()),
        "script=/etc/passwd".to_owned(),
        "slaves=drive*2:objects@/etc/passwd,io".to_owned(),
    ] {
        let slaves = if named.starts_with("slaves") { "" } else { "&slaves=drive*2,io" };
        renamed(&program.file, &format!("sim:?clock=virtual&{named}{slaves}"), &file);
        let ran = run(["replay", file.to_str().expect("UTF-8")]);
        assert_eq!(ran.code, Some(2), "{ran:?}");
        assert!(!ran.err.contains("root") && ran.out.is_empty(), "{}", ran.err);
        if named.starts_with("script") {
            ran.expect_failure(2, &["names a file (script=", "--allow-files"], "with --link");
        }
    }
    // If the user names the model by `--link`, the files that the recording's link names are not opened.
    renamed(&program.file, &format!("sim:?clock=virtual&script={}", pipe.display()), &file);
    let ran = run(["replay", file.to_str().expect("UTF-8"), "--link", "sim:?slaves=drive*2,io"]);
    assert!(ran.code == Some(0) && ran.out.contains("\nequal: "), "{ran:?}");
    run(["replay", program.path(), "--link", "sim:", "--allow-files"]).expect_misuse(&["--allow-files", "--link"]);
}
