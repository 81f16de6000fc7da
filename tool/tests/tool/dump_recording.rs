//! `ecmsk dump FILE`: recordings in words and as JSON.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::recordings::{Script, make_capture, record_to_a_slow_disk};
use crate::common::{Ran, json_lines, run, run_with_input};
use ecmsk::sk::{Frame, MasterCommand, MasterState, SlotSize};
use serde_json::Value;
use tempfile::TempDir;
use vectors::{Vector, vector_named};

const LINK: &str = "sim:?slaves=drive*3&clock=virtual";
const MS: u64 = 1_000_000;

/// The golden frames with these names as a script, one every millisecond from 5 ms on.
fn golden(names: &[&str]) -> Script {
    let mut script = Script::default();
    for (i, vector) in (0..).zip(names.iter().map(|name| vector_named(name))) {
        pass(&mut script, (5 + i) * MS, &vector);
    }
    script
}

fn pass(script: &mut Script, at_ns: u64, vector: &Vector) {
    if vector.is_response() {
        script.response(at_ns, vector.frame());
    } else {
        script.command(at_ns, vector.frame());
    }
}

/// A recording in a folder of its own, and `dump` on it.
struct Recorded {
    _folder: TempDir,
    file: PathBuf,
}

impl Recorded {
    fn new(script: &Script, link: &str, slot: Option<SlotSize>) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("run.pcapng");
        script.record(&file, link, slot);
        Self { _folder: folder, file }
    }

    fn dump(&self, options: &[&str]) -> Ran {
        dump(&self.file, options)
    }

    fn json(&self, options: &[&str]) -> Vec<Value> {
        let out = self.dump(&[&["--json"], options].concat()).expect_quiet();
        json_lines(&out)
    }
}

fn dump(file: &Path, options: &[&str]) -> Ran {
    let file = file.to_str().expect("UTF-8");
    run([&["dump", file], options].concat())
}

/// The names of golden frames of several kinds: commands to slot 0, to slaves and in the SDO slot, and responses.
const MIXED: [&str; 7] = [
    "set-axis-group0",
    "resp-preop-nocrc",
    "sdo-wr-6060-homing",
    "resp-sdo-wr",
    "csp-index-7",
    "resp-op-fw17",
    "io-wr",
];

/// `dump` prints a recording as text: the link, then every frame with its number, its time and its slots.
#[test]
fn a_recording_is_dumped_frame_by_frame_with_its_link() {
    let recorded = Recorded::new(&golden(&MIXED), LINK, Some(SlotSize::Bytes12));
    support::snapshot("dump_recording", &recorded.dump(&[]).expect_quiet());
}

/// `dump --json` prints a recording as JSON lines, with each time since the first frame and as recorded.
#[test]
fn a_recording_is_dumped_as_json_lines_with_both_times() {
    let recorded = Recorded::new(&golden(&MIXED), LINK, Some(SlotSize::Bytes12));
    let frames = recorded.json(&[]);
    assert_eq!(frames.len(), MIXED.len());
    for (i, (frame, name)) in (0..).zip(frames.iter().zip(MIXED)) {
        assert_eq!(frame["number"], i + 1, "{name}");
        assert_eq!(frame["time_ns"], i * MS, "{name}");
        assert_eq!(frame["recorded_ns"], (5 + i) * MS, "{name}");
        let direction = if vector_named(name).is_response() { "response" } else { "command" };
        assert_eq!((&frame["direction"], &frame["direction_guessed"]), (&direction.into(), &false.into()), "{name}");
    }
    // The recording has a SET_AXIS before this frame, so the kind of slave 1 is known.
    assert_eq!(
        (&frames[5]["slots"][1]["kind"], &frames[5]["slots"][1]["kind_from"]),
        (&"drive".into(), &"given".into())
    );
}

/// A report that was read late was made before commands that precede it in the file: its time shows that.
#[test]
fn a_report_that_was_read_late_has_the_time_at_which_it_was_made() {
    let mut script = golden(&["csp-index-7"]);
    pass(&mut script, 2 * MS, &vector_named("resp-op-fw17"));
    let recorded = Recorded::new(&script, LINK, Some(SlotSize::Bytes12));
    assert_eq!(recorded.json(&[])[1]["time_ns"], -3 * MS.cast_signed());
    let text = recorded.dump(&[]).expect_quiet();
    assert!(text.contains("frame 2        -0.003000000 s  response\n"), "{text}");
}

/// The slot size comes from the recording or the user, else from the CRCs, also of later frames.
#[test]
fn the_slot_size_is_that_of_the_recording_the_user_or_the_crcs() {
    let sizes = |recorded: &Recorded, options: &[&str]| -> Vec<_> {
        recorded.json(options).iter().map(|frame| frame["slot_bytes"].as_u64()).collect()
    };
    let mut script = Script::default();
    script.command(MS, Frame::new());
    for at in 2..6 {
        pass(&mut script, at * MS, &vector_named("resp-op-16"));
    }
    let untold = Recorded::new(&script, "usb:", None);
    assert_eq!(sizes(&untold, &[]), [Some(16); 5]);
    assert_eq!(sizes(&untold, &["--slot-size", "12"]), [Some(12); 5]);
    let told = Recorded::new(&script, "usb:", Some(SlotSize::Bytes12));
    assert_eq!(sizes(&told, &[]), [Some(12); 5]);
    assert_eq!(sizes(&told, &["--slot-size", "16"]), [Some(16); 5]);

    let mut script = Script::default();
    script.command(MS, Frame::new()).command(2 * MS, Frame::new());
    let nothing_tells = Recorded::new(&script, "usb:", None);
    let ran = nothing_tells.dump(&["--json"]);
    assert_eq!((ran.code, ran.out.matches("\"slot_bytes\":12").count()), (Some(0), 2));
    assert_eq!(ran.err.matches("no CRC tells the slot size, taken as 12 bytes").count(), 1, "{}", ran.err);
}

/// Byte 1 of a slave's slot is its mode in firmware 1.5: the recording's link or the user gives the firmware.
#[test]
fn firmware_1_5_shows_the_mode_in_byte_1() {
    let script = golden(&["resp-op-fw15"]);
    let old = Recorded::new(&script, "sim:?fw=1.5", Some(SlotSize::Bytes12));
    assert_eq!(old.json(&["--slots", "1"])[0]["slots"][0]["mode"], 8);
    assert_eq!(old.json(&["--slots", "1", "--fw", "1.7"])[0]["slots"][0]["index"], 8);
    let new = Recorded::new(&script, "sim:", Some(SlotSize::Bytes12));
    assert_eq!(new.json(&["--slots", "1"])[0]["slots"][0]["index"], 8);
    assert_eq!(new.json(&["--slots", "1", "--fw", "1.5"])[0]["slots"][0]["mode"], 8);
}

/// SET_AXIS in OP is rejected: it does not change the kinds of the slaves.
#[test]
fn a_set_axis_in_op_does_not_change_the_kinds_of_slaves() {
    let recorded =
        Recorded::new(&golden(&["resp-op-fw17", "set-axis-group0", "resp-hsp-12"]), LINK, Some(SlotSize::Bytes12));
    assert_eq!(recorded.json(&["--slots", "1"])[2]["slots"][0]["kind_from"], "guessed");
}

/// `--slots` selects the slots that are shown; `--all` shows all of them.
#[test]
fn only_the_slots_asked_for_are_shown() {
    let recorded = Recorded::new(&golden(&["csp-all-40"]), LINK, Some(SlotSize::Bytes12));
    let shown = |options: &[&str]| -> Vec<_> {
        let frames = recorded.json(options);
        frames[0]["slots"].as_array().expect("a list").iter().map(|slot| slot["slot"].as_u64()).collect()
    };
    assert_eq!(shown(&["--slots", "0,41"]), [Some(0), Some(41)]);
    assert_eq!(shown(&["--slots", "7", "--slots", "3"]), [Some(3), Some(7)]);
    assert_eq!(shown(&["--all"]).len(), 42);
    assert_eq!(shown(&[]).len(), 41, "the SDO slot is idle");
    recorded.dump(&["--slots", "42"]).expect_failure(1, &["12-byte slots has no slot 42"], "name slots from 0 to 41");
}

/// A recording that was cut off, at any place: the whole frames are shown, then an error says what to do.
#[test]
fn a_truncated_recording_is_shown_up_to_the_error() {
    let recorded = Recorded::new(&golden(&MIXED), LINK, Some(SlotSize::Bytes12));
    let whole = fs::read(&recorded.file).expect("a recording");
    let text = recorded.dump(&[]).expect_quiet();
    let cut = recorded.file.with_extension("cut");
    for len in (1..whole.len()).step_by(97).chain([whole.len() - 1]) {
        fs::write(&cut, &whole[..len]).expect("a file");
        let ran = dump(&cut, &[]);
        assert!(text.starts_with(&ran.out), "{len} bytes: {}", ran.out);
        // If the cut is between two blocks of the pcapng format, nothing is truncated, and there is no error.
        if ran.code != Some(0) {
            assert_eq!(ran.code, Some(1), "{len} bytes: {ran:?}");
            assert!(ran.err.starts_with("error: ") && ran.err.contains("; "), "{len} bytes: {}", ran.err);
        }
    }
    fs::write(&cut, &whole[..whole.len() / 2]).expect("a file");
    let ran = dump(&cut, &[]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.out.contains("frame 2 ") && ran.err.contains("ends in the middle of the block at byte"), "{ran:?}");
}

/// A recording with changed bytes gives an error or other frames, and never a crash.
#[test]
fn a_damaged_recording_never_ends_in_a_panic() {
    let recorded = Recorded::new(&golden(&MIXED), LINK, Some(SlotSize::Bytes12));
    let whole = fs::read(&recorded.file).expect("a recording");
    let damaged = recorded.file.with_extension("damaged");
    for at in (0..whole.len()).step_by(61) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0xFF;
        fs::write(&damaged, &bytes).expect("a file");
        for options in [&[][..], &["--json", "--all"]] {
            let ran = dump(&damaged, options);
            assert!(matches!(ran.code, Some(0 | 1)), "byte {at}: {ran:?}");
            assert!(!ran.err.contains("panicked"), "byte {at}: {}", ran.err);
            let error = if options.is_empty() { "error: " } else { "{\"error\":" };
            assert_eq!(ran.code == Some(1), ran.err.contains(error), "byte {at}: {ran:?}");
        }
    }
}

/// A file that cannot be read, or is no recording, is an error with the next step.
#[test]
fn a_file_that_is_no_recording_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("file");
    dump(&file, &[]).expect_failure(1, &["file: No such file"], "check the path");
    dump(folder.path(), &[]).expect_failure(1, &["directory"], "check the path");
    fs::write(&file, "").expect("a file");
    dump(&file, &[]).expect_failure(1, &["is no recording (.ecmrec, .pcapng) and no capture"], "record=");
    fs::write(&file, "some text that is no capture, and longer than a header").expect("a file");
    dump(&file, &[]).expect_failure(1, &["is no recording (.ecmrec, .pcapng) and no capture"], "record=");
}

/// A recording may come from standard input.
#[test]
fn a_recording_is_read_from_standard_input() {
    let recorded = Recorded::new(&golden(&MIXED), LINK, None);
    let bytes = fs::read(&recorded.file).expect("a recording");
    assert_eq!(run_with_input(&["dump", "-"], bytes).expect_quiet(), recorded.dump(&[]).expect_quiet());
    run_with_input(&["dump", "-"], "text").expect_failure(
        1,
        &["standard input is no recording (.ecmrec, .pcapng) and no capture"],
        "record=",
    );
}

/// A recording without frames has nothing to show.
#[test]
fn a_recording_without_frames_has_nothing_to_show() {
    let recorded = Recorded::new(&Script::default(), LINK, None);
    assert_eq!(recorded.dump(&[]).expect_quiet(), "");
}

/// If a process opens a board again, its recording continues in the same file. `dump` shows all of it, with the link at each
/// opening, and no time occurs twice.
#[test]
fn a_recording_of_several_openings_is_one_dump_with_each_link() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    let mut script = Script::default();
    let mut frame = Frame::new();
    frame.put_master(SlotSize::Bytes12, &MasterCommand::SetState(MasterState::Op));
    script.command(MS, frame);
    script.record(&file, "sim:", Some(SlotSize::Bytes12));
    script.record(&file, "sim:?name=b", Some(SlotSize::Bytes12));
    let text = dump(&file, &[]).expect_quiet();
    let heads: Vec<_> = text.lines().filter(|line| !line.starts_with("  ")).collect();
    let expected =
        ["# sim:", "frame 1         0.000000000 s  command", "# sim:?name=b", "frame 2         0.001000000 s  command"];
    assert_eq!(heads, expected);
}

/// Frames that the disk did not take are counted in the recording, and a note says how many.
#[test]
fn frames_missing_from_a_recording_are_noted() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    // More frames than the recorder's queue and the block that is being written have room for.
    let lost = record_to_a_slow_disk(&file, 1000);
    assert!(lost > 0, "nothing was lost");
    let ran = dump(&file, &["--slots", "0"]);
    assert_eq!((ran.code, ran.out.matches("\nframe ").count() as u64), (Some(0), 1000 - lost));
    let name = file.display();
    assert_eq!(
        ran.err,
        format!(
            "note: {name}: {lost} frames are missing: the disk was too slow; record again, to a disk that is fast and has room, to have them all\n"
        )
    );
}

/// A capture of two real boards: each has its own slaves, and the text distinguishes them.
#[test]
fn in_a_capture_of_two_boards_each_has_its_own_slaves() {
    let script = golden(&["set-axis-group0", "resp-hsp-12", "resp-hsp-12"]);
    let recorded = Recorded::new(&script, LINK, Some(SlotSize::Bytes12));
    make_capture(&recorded.file, &[7, 7, 8]);
    let text = recorded.dump(&["--slots", "1"]).expect_quiet();
    let lines: Vec<_> = text.lines().map(|line| line.split(" statusword").next().unwrap_or_default()).collect();
    let expected = [
        "# bus 1, device 7",
        "frame 1         0.000000000 s  command",
        "  slave 1  GET_STATUS",
        "frame 2         0.001000000 s  response",
        "  slave 1  CSP #2 DRIVE",
        "# bus 1, device 8",
        "frame 3         0.002000000 s  response",
        "  slave 1  CSP #2 DRIVE?",
    ];
    assert_eq!(lines, expected);
}
