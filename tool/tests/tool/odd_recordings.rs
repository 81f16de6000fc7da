//! Recordings with a damaged block, with positions past the largest one, and with odd times.

use std::fs;
use std::path::{Path, PathBuf};

use ecmsk::sk::{Frame, MasterState, SlotSize, StateByte};
use tempfile::TempDir;

use crate::common::board::text;
use crate::common::motion::FakeBoard;
use crate::common::plots::Recorded;
use crate::common::recordings::Script;
use crate::common::run;

/// Both axes go 10 counts in each cycle, from `start` on.
fn go(board: &mut FakeBoard, start: i32, cycles: std::ops::Range<i32>) {
    for n in cycles {
        board.send(&[start.wrapping_add(10 * n); 2]);
        board.cycle();
    }
}

/// Records a motion from `start` on, in blocks of 1,024 frames, which are half a second. After so many cycles of 1 ms the FIFO
/// is empty for 40 ms, and the motion goes on for 500 ms.
fn recorded(start: i32, cycles: i32) -> (TempDir, PathBuf) {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 2);
    (board.targets, board.positions) = (vec![start; 2], vec![start; 2]);
    go(&mut board, start, 0..cycles);
    for _ in 0..40 {
        board.cycle();
    }
    go(&mut board, start, cycles..cycles + 500);
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.ecmrec");
    board.script.record(&file, "sim:?slaves=drive*3&clock=virtual", Some(board.size));
    (folder, file)
}

/// Changes a bit of a block of frames, counted from 1, at this distance from its beginning.
fn damage(file: &Path, block: usize, at: usize) {
    let mut bytes = fs::read(file).expect("a file");
    let places: Vec<usize> = (0..bytes.len() - 8).filter(|at| bytes[*at..].starts_with(b"\x89ECMREC\n")).collect();
    bytes[places[block] + at] ^= 1;
    fs::write(file, bytes).expect("a file");
}

fn utf8(file: &Path) -> &str {
    file.to_str().expect("UTF-8")
}

/// The summary has the values of an even motion, and its one gap. `find` finds no other, and ends with `code`.
#[track_caller]
fn is_even(file: &Path, code: i32) {
    let json = run(["summary", "--json", utf8(file)]).json();
    for axis in json["axes"].as_array().expect("axes") {
        let value = |quantity: &str| axis[quantity]["value"].as_f64().expect("a number");
        let values = ["following_error", "target_step", "velocity"].map(value);
        assert!(values[0] < 110.0 && values[1] <= 10.0 && values[2] <= 11_000.0, "{json}");
    }
    assert_eq!(json["counts"]["gaps"], 1, "{json}");
    let ran = run(["find", "following_error(1) > 1000 or target_step(1) > 100", utf8(file)]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(code), ""), "{ran:?}");
}

/// What was in force before a damaged block says nothing behind it: no following error, no step of the target comes of it,
/// and a later gap is one as ever, also in trends, in which what is missing is not recorded. `assert` does not call a rule
/// broken.
#[test]
fn a_damaged_block_gives_no_false_values() {
    let (_folder, file) = recorded(0, 2000);
    let recorded_s = || {
        let part = run(["summary", "--json", "--by", "recording", utf8(&file)]).json()["parts"][0].take();
        assert!(part["gaps"] == 1 && part["lost_commands"] == 0, "{part}");
        part["recorded_s"].as_f64().expect("seconds")
    };
    is_even(&file, 1);
    let whole_s = recorded_s();
    damage(&file, 3, 100);
    is_even(&file, 2);
    assert!((0.4..0.6).contains(&(whole_s - recorded_s())), "{whole_s}");
    let limits = "format = 1\n[axes.1]\nfollowing_error = 1000\ntarget_step = 100\nvelocity = 20000\n";
    let rules = file.with_file_name("rules.toml");
    fs::write(&rules, limits).expect("a file");
    let ran = run(["assert", utf8(&file), utf8(&rules)]);
    assert_eq!(ran.code, Some(2), "{ran:?}");
    assert!(ran.err.contains("no rule is broken, but the recording is not whole"), "{ran:?}");
}

/// Positions have 32 bits, and an axis may turn without end.
#[test]
fn positions_go_on_past_the_largest_one() {
    let (_folder, file) = recorded(i32::MAX - 10_005, 2000);
    is_even(&file, 1);
}

/// A plot of a range in which the header of a block is damaged reads all of the recording, and names the damage.
#[test]
fn a_plot_of_a_range_with_a_damaged_header_names_the_damage() {
    let (_folder, file) = recorded(0, 10_000);
    damage(&file, 10, 20);
    let ran = run(["plot", "--from", "4.2", "--to", "4.8", utf8(&file)]);
    assert!(ran.code == Some(0) && ran.err.contains("damaged, and not read: from 4."), "{ran:?}");
}

/// A value that is exactly the limit in units is not above it.
#[test]
fn a_limit_in_units_is_exact() {
    let machine = text("exact.toml", "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.0001 }\n");
    let mut board = FakeBoard::new(SlotSize::Bytes12, 2);
    go(&mut board, 0, 0..571);
    let recorded = Recorded::new(&board);
    for (expression, code) in [("target(X) > 0.57", 1), ("target(X) >= 0.57", 0)] {
        let ran = run(["find", expression, utf8(&recorded.file), "--machine", &machine]);
        assert_eq!(ran.code, Some(code), "{expression}: {ran:?}");
    }
    let step = run(["summary", utf8(&recorded.file), "--machine", &machine, "--fail-on", "target-step>0.001mm"]);
    assert_eq!(step.code, Some(0), "{step:?}");
}

/// Times at the ends of their range are no panic.
#[test]
fn odd_times_are_judged() {
    let report = |state| {
        let mut frame = Frame::new();
        frame.bytes_mut()[2] = StateByte::reached(state).0;
        frame.fill_crc(SlotSize::Bytes12);
        frame
    };
    let mut script = Script::default();
    script.command(u64::MAX / 2 + 10, Frame::new());
    script.response(0, report(MasterState::SafeOp)).response(u64::MAX, report(MasterState::Op));
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    script.record(&file, "sim:?clock=virtual", Some(SlotSize::Bytes12));
    let rules = text(
        "odd_times.toml",
        "format = 1\n[[events]]\nstate = \"safeop\"\n[[events]]\nstate = \"op\"\nwithin = \"1s\"\n",
    );
    let ran = run(["assert", utf8(&file), &rules]);
    assert!(matches!(ran.code, Some(0 | 1)) && !ran.err.contains("panicked"), "{ran:?}");
}
