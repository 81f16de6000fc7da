//! `ecmsk recording`, and recordings in blocks (`.ecmrec`) in the other verbs.

use std::fs;
use std::path::Path;

use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use ecmsk::sk::{DriveResponse, MasterResponse, MasterState, SlotSize};
use support::recorded::{Program, Run};

use crate::common::run;

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// Exports the recording of a run to a file beside it, with this file name extension; returns its path.
fn exported(whole: &Run, ending: &str) -> std::path::PathBuf {
    let file = whole.file.with_extension(ending);
    run(["recording", "export", whole.path(), text(&file)]).expect_quiet();
    file
}

/// A recording in blocks (.ecmrec) that was exported from a pcapng gives the same output in every verb. Exported back it
/// becomes the same pcapng, byte by byte.
#[test]
fn every_verb_reads_both_formats_alike() {
    let program = Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() };
    let whole = program.record();
    let blocks = exported(&whole, "ecmrec");
    assert!(fs::metadata(&blocks).expect("a file").len() * 25 < fs::metadata(&whole.file).expect("a file").len());
    let back = whole.file.with_file_name("back.pcapng");
    run(["recording", "export", text(&blocks), text(&back)]).expect_quiet();
    assert!(fs::read(&back).expect("a file") == fs::read(&whole.file).expect("a file"), "another pcapng");

    for verb in [&["dump"][..], &["dump", "--json"], &["summary"], &["summary", "--json"], &["migrate", "--json"]] {
        let [pcapng, ecmrec] = [whole.path(), text(&blocks)].map(|file| run(verb.iter().chain(&[file])));
        assert_eq!(ecmrec.out.replace("run.ecmrec", "run.pcapng"), pcapng.out, "{verb:?}");
        assert_eq!((ecmrec.code, ecmrec.err), (pcapng.code, pcapng.err), "{verb:?}");
    }
    let compared = run(["compare", whole.path(), text(&blocks)]).expect_quiet();
    assert!(compared.contains("\nequal: "), "{compared}");
    let pictures: Vec<String> = [&whole.file, &blocks]
        .map(|file| {
            let picture = file.with_extension("svg");
            run(["plot", text(file), "-o", text(&picture), "--axes", "1,2", "--from", "0.5", "--to", "0.55"])
                .expect_quiet();
            fs::read_to_string(picture).expect("a picture").replace("run.ecmrec", "run.pcapng")
        })
        .into();
    assert!(pictures[0] == pictures[1], "another picture");
}

/// With `--from` and `--to`, `plot` reads only the blocks of that range: damage elsewhere is not noticed. A range without
/// OP names the time in OP of the whole recording.
#[test]
fn a_plot_of_a_range_reads_only_its_blocks() {
    let folder = tempfile::tempdir().expect("a folder");
    let blocks = folder.path().join("run.ecmrec");
    let link = format!("sim:?slaves=drive&clock=virtual&record={}", blocks.display());
    let words = ["move", "1=1000000", "--velocity", "100000", "--yes", "--up", "--machine", "none", "--link", &link];
    assert_eq!(run(words).code, Some(0), "ten seconds of motion");
    let mut bytes = fs::read(&blocks).expect("a file");
    let at = bytes.len() * 2 / 3;
    bytes[at..at + 16].fill(0xFF);
    fs::write(&blocks, bytes).expect("a file");
    let plot = |options: &[&str]| run(["plot", text(&blocks)].iter().chain(options));
    plot(&["--from", "1", "--to", "1.5"]).expect_quiet();
    let all = plot(&[]);
    assert!(all.err.contains("damaged"), "{all:?}");
    let nothing = plot(&["--from", "0", "--to", "0"]);
    assert!(nothing.err.contains("asked for 0 s to 0 s"), "{nothing:?}");
}

/// `recording export` writes a table with a row for each report in OP, with the values of its slaves.
#[test]
fn a_table_has_the_reports() {
    const SIZE: SlotSize = SlotSize::Bytes12;
    let whole = Program::default().record();
    let table = fs::read_to_string(exported(&whole, "csv")).expect("a table");
    let mut rows = table.lines().map(|row| row.split(',').collect::<Vec<_>>());
    let names = rows.next().expect("the names");
    assert_eq!(names[..4], ["time_s", "fifo_free", "full_count", "crc_errors"]);
    assert_eq!(names.last(), Some(&"3_bits"));
    let position = names.iter().position(|name| *name == "2_position").expect("a column");
    let rows: Vec<_> = rows.collect();
    let frames = Recording::open(&whole.file).expect("a recording").map(|recorded| recorded.expect("whole"));
    let reports = frames.filter(|recorded| recorded.dir == Dir::Read).filter(|recorded| {
        MasterResponse::decode(&recorded.frame.slot(SIZE, 0)).state.state() == Some(MasterState::Op)
    });
    let positions: Vec<String> =
        reports.map(|report| DriveResponse::decode(&report.frame.slot(SIZE, 2)).position.to_string()).collect();
    assert!(positions.len() > 300);
    assert_eq!(rows.iter().map(|row| row[position].to_owned()).collect::<Vec<_>>(), positions);
    assert!(rows.iter().all(|row| row.len() == names.len()));
}

/// `recording info` shows from the index what is in a recording. With `--check` it reads all frames and shows where the
/// recording is damaged. `summary` reports the damage, too.
#[test]
fn damage_is_told_with_its_time() {
    let whole = Program::default().record();
    let blocks = exported(&whole, "ecmrec");
    let info = run(["recording", "info", text(&blocks)]).expect_quiet();
    assert!(info.contains("in 1 recording, with an index\nlacks: not looked for"), "{info}");
    let json = run(["recording", "info", "--json", whole.path()]).json();
    let checked = run(["recording", "info", "--json", "--check", text(&blocks)]).json();
    for key in ["frames", "seconds", "first_ns", "last_ns", "link", "lacks", "checked"] {
        assert_eq!(json[key], checked[key], "{key}");
    }
    let mut bytes = fs::read(&blocks).expect("a file");
    // A byte of the second block of frames is changed. The first block of frames, and the block before it with the metadata,
    // stay whole.
    let places: Vec<usize> = (0..bytes.len() - 8).filter(|at| bytes[*at..].starts_with(b"\x89ECMREC\n")).collect();
    bytes[places[2] + 100] ^= 1;
    fs::write(&blocks, bytes).expect("a file");
    let info = run(["recording", "info", "--check", text(&blocks)]).expect_quiet();
    assert!(info.contains("lacks: damaged, and not read: from 0."), "{info}");
    let ran = run(["summary", "--exit-code", text(&blocks)]);
    assert!(ran.code == Some(1) && ran.err.contains("damaged, and not read: from 0."), "{ran:?}");
    let copy = whole.file.with_file_name("copy.pcapng");
    let ran = run(["recording", "export", text(&blocks), text(&copy)]);
    assert!(ran.code == Some(0) && ran.err.contains("damaged"), "{ran:?}");
    let ran = run(["summary", text(&copy)]);
    assert!(ran.err.contains("frames are missing: they were damaged in the file that was copied"), "{ran:?}");
}

/// An export that is not possible is an error that says why, and changes no file.
#[test]
fn a_wrong_export_is_refused() {
    let whole = Program::default().record();
    let there = whole.file.with_file_name("there.csv");
    fs::write(&there, "a letter").expect("a file");
    let export = |output: &Path| run(["recording", "export", whole.path(), text(output)]);
    export(&there).expect_failure(1, &["there.csv is there already"], "replace it with --overwrite");
    let nothing = ["recording", "export", whole.path(), text(&there), "--overwrite"];
    for (more, words) in [(&["--from", "9999"][..], "no report in OP"), (&["--axes", "1,9"], "no slave 9")] {
        let ran = run([&nothing[..], more].concat());
        assert!(ran.code == Some(1) && ran.err.contains(words), "{ran:?}");
    }
    run([&nothing[..], &["--axes", "0"]].concat()).expect_misuse(&["--axes", "1..=40"]);
    assert_eq!(fs::read_to_string(&there).expect("a file"), "a letter");
    export(&whole.file.with_extension("xls")).expect_failure(
        1,
        &["run.xls"],
        "name it .pcapng, .ecmrec, .csv, .mcap, .arrow or .feather",
    );
    export(&whole.file).expect_failure(1, &["is the recording itself"], "name another file");
    let capture = support::root().join("tests/recordings/usbmon_12.pcap");
    let ran = run(["recording", "export", text(&capture), text(&whole.file.with_extension("ecmrec"))]);
    ran.expect_failure(1, &["usbmon_12.pcap", "a capture of another program"], "exported as a table, such as .csv");
}

/// An export that a full disk ends, or that finds nothing, leaves the file that was there, and nothing beside it.
#[cfg(unix)]
#[test]
fn a_failed_export_leaves_the_old_file() {
    let whole = Program::default().record();
    let folder = tempfile::tempdir().expect("a folder");
    for ending in ["csv", "mcap", "arrow", "ecmrec", "pcapng"] {
        let file = folder.path().join(format!("old.{ending}"));
        let export = |before: &str, more: &str| {
            let tool = env!("CARGO_BIN_EXE_ecmsk");
            let words = format!("{before} '{tool}' recording export '{}' '{}' {more}", whole.path(), text(&file));
            std::process::Command::new("sh").args(["-c", &words]).output().expect("sh starts").status.success()
        };
        assert!(export("", ""));
        let old = fs::read(&file).expect("a table");
        // The shell limits files to 1 KiB, as if the disk were full after that.
        for (before, more) in [("", "--from 9999"), ("trap '' XFSZ; ulimit -f 2;", "")] {
            assert!(!export(before, &format!("--overwrite {more}")), "{ending}");
            assert!(fs::read(&file).expect("a table") == old, "{ending}");
            assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1, "{ending}");
        }
        assert!(export("", "--overwrite"));
        fs::remove_file(&file).expect("it is there");
    }
}

/// `--record FILE.ecmrec` of a verb: the file is whole, and a second run asks for `--overwrite`.
#[test]
fn a_verb_records_in_blocks() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.ecmrec");
    let motion = ["move", "1=100", "--up", "--link", "sim:?slaves=drive&clock=virtual", "--record", text(&file)];
    let ran = run(motion);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let summary = run(["summary", "--exit-code", text(&file)]).expect_quiet();
    assert!(summary.contains("axis 1"), "{summary}");
    assert!(run(motion).err.contains("--overwrite"));
    assert_eq!(run(motion.iter().chain(&["--overwrite"])).code, Some(0));
}
