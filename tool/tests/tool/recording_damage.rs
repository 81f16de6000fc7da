//! Recordings that were cut, joined, written by a newer version, or made while the clock was set: every verb ends, and says
//! what it could not read.

use std::fs;
use std::path::Path;

use ecmsk::link::record::RecordingCopy;
use ecmsk::recording::{Lacks, RecordMeta, Recorded, Recording};
use support::dice::Dice;
use support::recorded::{Program, Run};
use support::recording::crc32;

use crate::common::{Ran, run};

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// A recording as pcapng and in blocks.
fn recorded() -> (Run, [Vec<u8>; 2]) {
    let whole = Program::default().record();
    let blocks = whole.file.with_extension("ecmrec");
    run(["recording", "export", whole.path(), text(&blocks)]).expect_quiet();
    let bytes = [&whole.file, &blocks].map(|file| fs::read(file).expect("a file"));
    (whole, bytes)
}

/// The output of every verb that reads a recording, with the words of its command line.
fn read_by_all(file: &Path) -> Vec<(Vec<String>, Ran)> {
    let out = |ending: &str| file.with_file_name(format!("out.{ending}")).display().to_string();
    let file = text(file);
    let (csv, mcap, arrow, copy) = (out("csv"), out("mcap"), out("arrow"), out("ecmrec"));
    let verbs: [&[&str]; 13] = [
        &["recording", "info", file],
        &["recording", "info", "--check", file],
        &["recording", "export", "--overwrite", file, &csv],
        &["recording", "export", "--overwrite", file, &mcap],
        &["recording", "export", "--overwrite", "--from", "0.5", "--to", "0.6", file, &arrow],
        &["recording", "export", "--overwrite", file, &copy],
        &["summary", file],
        &["summary", "--by", "recording", "--json", file],
        &["dump", "--json", file],
        &["find", "position(1) > 100", file],
        &["plot", "--from", "0.5", "--to", "0.6", "-o", &out("svg"), file],
        &["compare", file, file],
        &["monitor", "--once", "--recording", file],
    ];
    verbs.iter().map(|words| (words.iter().map(ToString::to_string).collect(), run(*words))).collect()
}

/// Asserts that each verb has ended with a code of its own, and without a panic. Returns what was said on standard error.
fn ended(file: &Path) -> Vec<String> {
    let ran = read_by_all(file);
    for (words, ran) in &ran {
        let Ran { code, err, .. } = ran;
        assert!(matches!(code, Some(0..=2)) && !err.contains("panicked"), "{words:?}: {code:?} {err}");
        let is_said = |line: &str| ["note: ", "error: ", "{\"error\":"].iter().any(|begin| line.starts_with(begin));
        assert!(*code == Some(0) || err.lines().any(is_said) || words[0] == "find", "{words:?}: {code:?} {err}");
    }
    ran.into_iter().map(|(_, ran)| ran.err).collect()
}

/// A recording that ends at any byte is read up to there by every verb.
#[test]
fn a_cut_recording_is_read_up_to_the_cut() {
    let (whole, formats) = recorded();
    let mut dice = Dice(42);
    for (bytes, ending) in formats.iter().zip(["pcapng", "ecmrec"]) {
        let file = whole.file.with_file_name(format!("cut.{ending}"));
        let anywhere = (0..3).map(|_| dice.below(bytes.len() as u64) as usize);
        for end in [0, 1, 100, bytes.len() - 1].into_iter().chain(anywhere) {
            fs::write(&file, &bytes[..end]).expect("a file");
            let said = ended(&file);
            // Those that read to the end.
            for verb in [2, 6, 7] {
                assert!(!said[verb].is_empty(), "{ending} {end}: verb {verb}");
            }
        }
    }
}

/// Joined files are read one after the other, also with damage between; a file of another format behind the first one is
/// damage.
#[test]
fn joined_recordings_are_read() {
    let (whole, [pcapng, blocks]) = recorded();
    let file = whole.file.with_file_name("joined.ecmrec");
    let frames = |file: &Path| -> u64 {
        run(["recording", "info", "--check", "--json", text(file)]).json()["frames"].as_u64().expect("a number")
    };
    let one = frames(&whole.file);
    for (parts, expected) in [
        (vec![&blocks[..], &blocks], 2 * one),
        (vec![&pcapng[..], &pcapng], 2 * one),
        (vec![&blocks[..], &[0xA5; 5000], &blocks], 2 * one),
        (vec![&blocks[..], &pcapng], one),
        (vec![&pcapng[..], &blocks], one),
    ] {
        fs::write(&file, parts.concat()).expect("a file");
        assert_eq!(frames(&file), expected);
        let said = ended(&file);
        let is_damaged = parts.len() > 2 || expected == one;
        assert_eq!(said[6].contains("damaged"), is_damaged, "{}", said[6]);
    }
}

/// A recording of a newer version of the format is no damaged one: each verb says which program reads it.
#[test]
fn a_newer_recording_says_so() {
    const HEADER: usize = 64;
    let (whole, [_, mut bytes]) = recorded();
    let places: Vec<usize> = (0..bytes.len() - 8).filter(|at| bytes[*at..].starts_with(b"\x89ECMREC\n")).collect();
    for at in places {
        bytes[at + 8] += 1;
        let crc = crc32(&bytes[at..at + HEADER - 4]).to_le_bytes();
        bytes[at + HEADER - 4..at + HEADER].copy_from_slice(&crc);
    }
    let file = whole.file.with_file_name("newer.ecmrec");
    fs::write(&file, bytes).expect("a file");
    let said = ended(&file);
    for verb in [6, 7, 8] {
        assert!(said[verb].contains("a newer version of ecmsk"), "verb {verb}: {}", said[verb]);
    }
    let info = run(["recording", "info", "--check", text(&file)]);
    info.expect_failure(1, &["nothing of", "newer.ecmrec"], "a newer version of ecmsk");
}

/// The clock of the machine was set back and forth during the recording: times go on, and verbs say so. Tables have times
/// that never go back.
#[test]
fn a_clock_that_was_set_leaves_times_that_go_on() {
    const HOUR_NS: u64 = 3_600_000_000_000;
    let (whole, _) = recorded();
    let mut recording = Recording::open(&whole.file).expect("a recording");
    let frames: Vec<Recorded> = recording.by_ref().map(|frame| frame.expect("whole")).collect();
    let meta = recording.meta().expect("its metadata").clone();
    let meta = RecordMeta { base_ns: meta.base_ns + 10 * HOUR_NS, ..meta };
    let times = |file: &Path| -> Vec<f64> {
        let csv = file.with_extension("csv");
        let ran = run(["recording", "export", "--overwrite", text(file), text(&csv)]);
        assert_eq!(ran.code, Some(0), "{ran:?}");
        let table = fs::read_to_string(csv).expect("a table");
        table.lines().skip(1).map(|row| row.split(',').next().expect("a time").parse().expect("a number")).collect()
    };
    let right = times(&whole.file);
    for (name, hours) in [("back", 9_u64), ("forth", 14)] {
        for ending in ["pcapng", "ecmrec"] {
            let file = whole.file.with_file_name(format!("{name}.{ending}"));
            let mut copy = RecordingCopy::new(&file, &meta);
            for (n, frame) in frames.iter().enumerate() {
                let hour = if n < frames.len() / 2 { 10 } else { hours };
                copy.add(&Recorded { at_ns: frame.at_ns + hour * HOUR_NS, ..frame.clone() }).expect("room");
            }
            copy.end(&Lacks::default()).expect("room on the disk");
            let said = ended(&file);
            assert!(said[6].contains("its times jump"), "{name} {ending}: {}", said[6]);
            let found = times(&file);
            assert_eq!(found.len(), right.len(), "{name} {ending}");
            // All but one step of the clock are as they were.
            let step = found.windows(2).find(|step| step[0] > step[1]);
            let (last, limit) = (found[found.len() - 1], 3601.0 + right[right.len() - 1]);
            assert!(step.is_none() && last < limit, "{name} {ending}: {step:?}, {last}");
        }
    }
}
