//! `ecmsk summary DIR`: trends over the recordings of a folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ecmsk::ecm::{Config, Ecm};
use ecmsk::link::options::Clock;
use ecmsk::link::record::RecordingCopy;
use ecmsk::recording::{CarriedFile, Lacks, RecordMeta, Recorded, Recording};
use ecmsk::sk::{MasterState, SlaveCommand, SlotSize};
use serde_json::Value;
use tempfile::TempDir;

use crate::common::motion::{ATTAINED, CSP, DriveSlot, ENABLED, FAULTED, FakeBoard, GO_HOME, UNDER_WAY};
use crate::common::recordings::Script;
use crate::common::{Ran, ecmsk, run};

const SECOND_NS: u64 = 1_000_000_000;
const DAY_NS: u64 = 86_400 * SECOND_NS;
/// 2026-03-02, 06:30 UTC.
const MONDAY_NS: u64 = 1_772_433_000 * SECOND_NS;

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// What differs from day to day.
#[derive(Clone, Copy, Default)]
struct Day {
    /// How much the axis is held back in each cycle of a motion, counts.
    wear: i32,
    /// Where homing finds home, counts.
    home: i32,
    /// The targets that wait in the FIFO, besides the next one.
    ahead: usize,
    /// Whether the program is late in a motion, a slave is lost, and the drive has an alarm.
    is_bad: bool,
}

/// A day of the machine: the axis homes, goes to 2000 and back.
fn day(day: Day) -> Script {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    let say = |board: &mut FakeBoard, id, statusword| board.drives[0] = DriveSlot { id, statusword, error_code: 0 };
    board.send_to(1, &SlaveCommand::GoHome);
    say(&mut board, GO_HOME, UNDER_WAY);
    for step in 0..60 {
        let at = day.home * step.min(50) / 50;
        (board.positions[0], board.targets[0]) = (at, at);
        board.cycle();
    }
    say(&mut board, GO_HOME, ATTAINED);
    (board.positions[0], board.targets[0]) = (0, 0);
    board.cycle();
    say(&mut board, CSP, ENABLED);
    (0..day.ahead).for_each(|_| board.send(&[0]));
    let mut target = 0;
    for (step, cycles) in [(0, 150), (10, 200), (0, 150), (-10, 200), (0, 150)] {
        for cycle in 0..cycles {
            if day.is_bad && step > 0 && cycle == 100 {
                // The program is late: the FIFO runs empty.
                (0..20).for_each(|_| board.cycle());
            }
            target += step;
            board.send(&[target]);
            board.cycle();
            board.positions[0] -= day.wear * i32::signum(step);
        }
    }
    if day.is_bad {
        board.lost = vec![1];
        (0..5).for_each(|_| board.cycle());
        board.lost.clear();
        board.drives[0] = DriveSlot { id: CSP, statusword: FAULTED, error_code: 0x7500 };
        (0..5).for_each(|_| board.cycle());
    }
    board.script
}

/// Keeps frames as a recording of the real clock that begins at this time.
fn keep(script: &Script, file: &Path, begins: &[u64]) {
    keep_with(script, file, begins, None);
}

/// The same; the recording carries a machine file.
fn keep_with(script: &Script, file: &Path, begins: &[u64], machine: Option<&str>) {
    let made = file.with_extension("made");
    script.record(&made, "sim:", Some(SlotSize::Bytes12));
    let mut recording = Recording::open(&made).expect("a recording");
    let frames: Vec<Recorded> = recording.by_ref().map(|frame| frame.expect("whole")).collect();
    let machine = machine.map(|text| Arc::new(CarriedFile::new(Path::new("machine.toml"), text)));
    let opened_ns = begins.first().copied();
    let meta = RecordMeta { clock: Clock::Real, machine, opened_ns, ..recording.meta().expect("its metadata").clone() };
    let mut copy = RecordingCopy::new(file, &meta);
    for begin_ns in begins {
        for frame in &frames {
            let at_ns = begin_ns + frame.at_ns - frames[0].at_ns;
            copy.add(&Recorded { at_ns, ..frame.clone() }).expect("room on the disk");
        }
    }
    copy.end(&Lacks::default()).expect("room on the disk");
    fs::remove_file(made).expect("it was there");
}

/// A folder with the recordings of three days, each of which the axis is more worn, and another home is found. The names
/// are in another order than the days, and the last day is bad.
fn three_days() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (n, name) in (0..).zip(["c.ecmrec", "b.pcapng", "a.ecmrec"]) {
        let made = day(Day { wear: n, home: 120 - 4 * n, ahead: 6 - 2 * n as usize, is_bad: n == 2 });
        keep(&made, &folder.path().join(name), &[MONDAY_NS + n as u64 * DAY_NS]);
    }
    folder
}

fn json(words: &[&str]) -> Value {
    let ran = run([&["summary", "--json"], words].concat());
    assert_eq!(ran.code, Some(0), "{ran:?}");
    ran.json()
}

/// The values of the axis in all parts.
fn of_axis<'a>(json: &'a Value, value: &[&str]) -> Vec<&'a Value> {
    let parts = json["parts"].as_array().expect("parts");
    parts.iter().map(|part| value.iter().fold(&part["axes"][0], |found, name| &found[*name])).collect()
}

fn of_parts<'a>(json: &'a Value, name: &str) -> Vec<&'a Value> {
    json["parts"].as_array().expect("parts").iter().map(|part| &part[name]).collect()
}

/// A line for each recording, oldest first: the following error of the same motion grows, home moves, the reserve falls; the
/// bad day has its gap, its lost slave and its alarm.
#[test]
fn what_changes_from_day_to_day_is_shown() {
    let folder = three_days();
    let found = json(&[text(folder.path())]);
    assert_eq!(of_parts(&found, "name"), ["c.ecmrec", "b.pcapng", "a.ecmrec"]);
    let begins = ["2026-03-02T06:30:00Z", "2026-03-03T06:30:00Z", "2026-03-04T06:30:00Z"];
    assert_eq!(of_parts(&found, "begin"), begins);
    let same: Vec<u64> = of_axis(&found, &["same_motion", "following_error"])
        .iter()
        .map(|error| error.as_u64().expect("the motion is in all of them"))
        .collect();
    assert!((80..110).contains(&same[0]) && same[1] >= same[0] + 8 && same[2] >= same[1] + 8, "{same:?}");
    let ends = ["from", "to"].map(|end| of_axis(&found, &["same_motion", end])[0].clone());
    assert!(ends == [0, 2000] || ends == [2000, 0], "{ends:?}");
    assert_eq!(of_axis(&found, &["homings", "found_at"]), [120, 116, 112]);
    assert_eq!(of_axis(&found, &["homings", "change"]), [0, -4, -8]);
    let reserve: Vec<u64> =
        of_parts(&found, "fifo_reserve").iter().map(|reserve| reserve.as_u64().expect("it moved")).collect();
    assert!(reserve[0] >= 5 && reserve[0] > reserve[1] && reserve[1] > reserve[2], "{reserve:?}");
    for what in ["gaps", "lost_slaves", "alarms"] {
        assert_eq!(of_parts(&found, what), [0, 0, 1], "{what}");
    }
    assert_eq!(reserve[2], 0, "a gap");
    assert_eq!(of_parts(&found, "incomplete"), [0, 0, 0]);

    let days = json(&["--by", "day", text(folder.path())]);
    assert_eq!(of_parts(&days, "name"), ["2026-03-02", "2026-03-03", "2026-03-04"]);
    assert_eq!(of_axis(&days, &["homings"]), of_axis(&found, &["homings"]));

    let table = run(["summary", text(folder.path())]).expect_quiet();
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines[0].starts_with("recording  recorded") && lines[1].starts_with("c.ecmrec"), "{table}");
    assert!(lines.iter().any(|line| line.starts_with("axis 1; same motion: from ")), "{table}");
    assert!(
        lines.iter().any(|line| line.starts_with("b.pcapng") && line.ends_with("116 counts  -4 counts")),
        "{table}"
    );
}

/// The page has a picture of each axis and of the FIFO, and fetches nothing. With a machine file, units.
#[test]
fn trends_are_drawn() {
    let folder = three_days();
    let page = folder.path().join("page.html");
    let machine = folder.path().join("machine.toml");
    fs::write(&machine, "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.01 }\n").expect("a file");
    let words = ["summary", "--machine", text(&machine), "--html", text(&page), text(folder.path())];
    let ran = run(words);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(ran.out.contains("axis X; same motion: from ") && ran.out.contains("20.00 mm"), "{}", ran.out);
    assert!(ran.err.contains("machine.toml: passed over: "), "{}", ran.err);
    let html = fs::read_to_string(page).expect("a page");
    assert_eq!(html.matches("<svg ").count(), 2);
    for words in
        ["Axis X; same motion", "Following error (mm)", "Home: change against the first homing (mm)", "Gaps in"]
    {
        assert!(html.contains(words), "{words}");
    }
    for text in ["<script", "<link", "@import", "url("] {
        assert!(!html.contains(text), "{text}");
    }
}

/// `--fail-on` judges each recording, and names the one that fails.
#[test]
fn a_bad_day_fails() {
    let folder = three_days();
    let with = |reasons: &str| run(["summary", "--fail-on", reasons, text(folder.path())]);
    let ran = with("alarm,gap,following-error>100000");
    assert_eq!((ran.code, ran.err.lines().count()), (Some(1), 2), "{ran:?}");
    assert!(ran.err.lines().all(|line| line.starts_with("failed: ") && line.contains("a.ecmrec: 1 ")), "{ran:?}");
    assert_eq!(with("following-error>100000,torque>99999").code, Some(0));
    assert_eq!(run(["summary", "--exit-code", text(folder.path())]).code, Some(1));
    let xml = folder.path().join("found.xml");
    let ran = run(["summary", "--fail-on", "alarm,state,gap", "--junit", text(&xml), text(folder.path())]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(fs::read_to_string(xml).expect("a file").contains("tests=\"3\" failures=\"3\""));
    fs::remove_file(folder.path().join("a.ecmrec")).expect("it was there");
    assert_eq!(run(["summary", "--exit-code", "--fail-on", "any", text(folder.path())]).code, Some(0));
}

/// Each recording is judged in the units of the machine file that it carries, whatever file is in the working folder. Tables of
/// recordings with different units are in counts.
#[test]
fn each_recording_has_the_units_that_it_carries() {
    let machine = |per: &str| format!("format = 1\n[axes]\nX = {{ slave = 1, unit = \"mm\", per = {per} }}\n");
    let (folder, place) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let made = day(Day { wear: 5, ..Day::default() });
    let [a, b] = ["a.ecmrec", "b.ecmrec"].map(|name| folder.path().join(name));
    keep_with(&made, &a, &[MONDAY_NS], Some(&machine("0.001")));
    keep_with(&made, &b, &[MONDAY_NS + DAY_NS], Some(&machine("0.01")));
    fs::write(place.path().join("machine.toml"), machine("1.0")).expect("a file");
    let summary = |words: &[&str]| -> Ran {
        let mut command = ecmsk([&["summary"], words].concat());
        command.current_dir(place.path()).output().expect("the tool starts").into()
    };
    let error = of_axis(&json(&[text(folder.path())]), &["following_error"])[0].as_f64().expect("counts");
    assert!(error > 1.0, "{error}");
    // It is above the limit in the second one alone.
    let limit = format!("following-error>{}mm", error * 0.005);
    for words in [&["--fail-on", &*limit, text(folder.path())][..], &["--fail-on", &*limit, "--by", "day", text(&b)]] {
        let ran = summary(words);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        let failed: Vec<&str> = ran.err.lines().filter(|line| line.starts_with("failed: ")).collect();
        assert!(failed.len() == 1 && failed[0].contains("b.ecmrec: axis X: following error"), "{ran:?}");
    }
    assert_eq!(summary(&["--fail-on", &limit, "--by", "day", text(&a)]).code, Some(0));
    let both = summary(&[text(folder.path())]);
    assert!(both.err.contains("note: the recordings have different units") && !both.out.contains(" mm"), "{both:?}");
    let given = summary(&["--machine", "machine.toml", text(folder.path())]);
    assert!(!given.err.contains("different units") && given.out.contains(&format!("  {error} mm")), "{given:?}");
    fs::remove_file(a).expect("it was there");
    let one = summary(&[text(folder.path())]);
    assert!(one.out.contains(&format!("  {:.2} mm", error * 0.01)) && one.out.contains("axis X"), "{one:?}");
}

/// A recording over several hours has a line for each; many recordings are put together by days.
#[test]
fn parts_are_hours_and_days() {
    let folder = tempfile::tempdir().expect("a folder");
    let long = folder.path().join("long.ecmrec");
    let made = day(Day { ahead: 4, ..Day::default() });
    keep(&made, &long, &[MONDAY_NS, MONDAY_NS + 3500 * SECOND_NS]);
    let found = json(&["--by", "hour", text(&long)]);
    assert_eq!(of_parts(&found, "name"), ["2026-03-02 06 h", "2026-03-02 07 h"]);
    assert_eq!(of_axis(&found, &["homings", "times"]), [1, 1]);
    fs::remove_file(long).expect("it was there");

    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    for cycle in 0..10 {
        board.send(&[cycle]);
        board.cycle();
    }
    for n in 0..61 {
        keep(&board.script, &folder.path().join(format!("{n}.ecmrec")), &[MONDAY_NS + n * DAY_NS / 12]);
    }
    let found = json(&[text(folder.path())]);
    assert_eq!(found["by"], "day");
    let recordings = of_parts(&found, "recordings");
    assert_eq!((recordings.len(), recordings.iter().map(|n| n.as_u64().expect("a number")).sum::<u64>()), (6, 61));
}

/// What is no recording is named and passed over; a folder without one is an error, and so is what has no meaning.
#[test]
fn what_is_no_recording_is_passed_over() {
    let folder = three_days();
    let put = |name: &str, bytes: &[u8]| -> PathBuf {
        let file = folder.path().join(name);
        fs::write(&file, bytes).expect("a file");
        file
    };
    put("letter.txt", b"Dear Sir");
    put("empty.pcapng", b"");
    let cut = fs::read(folder.path().join("b.pcapng")).expect("a file");
    put("begun.pcapng", &cut[..100]);
    put("cut.pcapng", &cut[..cut.len() / 2]);
    fs::create_dir(folder.path().join("below")).expect("a folder");
    let ran = run(["summary", "--json", text(folder.path())]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    for name in ["letter.txt", "empty.pcapng", "begun.pcapng", "below"] {
        let line = ran.err.lines().find(|line| line.contains(name)).unwrap_or_else(|| panic!("{name}: {}", ran.err));
        assert!(line.starts_with("note: ") && line.contains(": passed over: "), "{line}");
    }
    assert!(ran.err.contains("cut.pcapng ends in the middle"), "{}", ran.err);
    let found = ran.json();
    assert_eq!(found["passed_over"].as_array().expect("files").len(), 4);
    assert_eq!(of_parts(&found, "name").len(), 4);
    assert!(of_parts(&found, "incomplete").contains(&&Value::from(1)));
    assert_eq!(run(["summary", "--fail-on", "following-error>100000", text(folder.path())]).code, Some(0));

    // Recordings of which nothing can be read are incomplete; a letter is none.
    let nights = tempfile::tempdir().expect("a folder");
    day(Day::default()).record(&nights.path().join("good.pcapng"), "sim:", Some(SlotSize::Bytes12));
    fs::write(nights.path().join("letter.txt"), "Dear Sir").expect("a file");
    let any = ["summary", "--fail-on", "any", text(nights.path())];
    assert_eq!(run(any).code, Some(0), "{:?}", run(any));
    fs::write(nights.path().join("begun.pcapng"), &cut[..100]).expect("a file");
    let ran = run(any);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.err.lines().any(|line| line.starts_with("failed: ") && line.contains("begun.pcapng")), "{}", ran.err);
    let junit = nights.path().join("any.xml");
    run(["summary", "--exit-code", "--junit", text(&junit), text(nights.path())]);
    assert!(fs::read_to_string(&junit).expect("a file").contains("begun.pcapng"));

    let empty = tempfile::tempdir().expect("a folder");
    run(["summary", text(empty.path())]).expect_failure(1, &["has no recording with frames"], "record into it");
    let missing = empty.path().join("missing");
    run(["summary", text(&missing)]).expect_failure(1, &["missing"], "check the path");
    let part = run(["summary", "--from", "5", text(folder.path())]);
    part.expect_failure(1, &["from the beginning of one recording"], "without --by");
    run(["summary", "--by", "day", "-"]).expect_failure(1, &["--by needs a file"], "save standard input");
    let made = day(Day::default());
    let file = empty.path().join("virtual.ecmrec");
    made.record(&file, "sim:?clock=virtual", Some(SlotSize::Bytes12));
    run(["summary", "--by", "day", text(&file)]).expect_failure(1, &["virtual clock"], "leave --by out");
    assert!(run(["summary", text(empty.path())]).expect_quiet().starts_with("recording"));
}

/// A recording of the real clock that is cut within its first block says what is damaged in seconds since the board was opened,
/// as ever.
#[test]
fn times_of_damage_count_from_the_beginning() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cut.ecmrec");
    keep(&day(Day::default()), &file, &[MONDAY_NS]);
    let mut bytes = fs::read(&file).expect("a file");
    let places: Vec<usize> = (0..bytes.len() - 8).filter(|at| bytes[*at..].starts_with(b"\x89ECMREC\n")).collect();
    bytes.truncate(places[1] + 100);
    fs::write(&file, bytes).expect("a file");
    let ran = run(["summary", text(&file)]);
    assert!(ran.err.contains("damaged, and not read: from 0.0"), "{ran:?}");
}

/// A recording that is being written is whole as far as it is written.
#[cfg(unix)]
#[test]
fn a_recording_that_is_being_written_is_no_failure() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("now.ecmrec");
    let ecm = Ecm::open(&format!("sim:?slaves=drive&clock=virtual&record={}", file.display())).expect("a board");
    ecm.configure(&Config::drives(1)).expect("a drive");
    ecm.set_state(MasterState::Op).expect("OP");
    let ran = run(["summary", "--exit-code", text(folder.path())]);
    assert!(ran.code == Some(0) && ran.err.contains("now.ecmrec: it is being written"), "{ran:?}");
    // Of a program that was killed it is a failure.
    let copy = folder.path().join("killed.ecmrec");
    fs::copy(&file, &copy).expect("a copy");
    let ran = run(["summary", "--exit-code", text(folder.path())]);
    assert!(ran.code == Some(1) && ran.err.contains("killed.ecmrec: the recording was not ended"), "{ran:?}");
    drop(ecm);
}

/// The folder of a flight recorder has a line for each segment, also while a process records to it; kept moments that are in
/// the ring are not counted twice.
#[cfg(unix)]
#[test]
fn a_flight_recorder_has_trends() {
    let place = tempfile::tempdir().expect("a folder");
    let flight = place.path().join("flight");
    let script = place.path().join("script");
    fs::write(&script, "at 35s alarm 1 0x7500\n").expect("a file");
    let link = format!("sim:?slaves=drive&clock=virtual&script={}&flight={}", script.display(), flight.display());
    let ecm = Ecm::open(&link).expect("a board");
    ecm.configure(&Config::drives(1)).expect("a drive");
    ecm.set_state(MasterState::Op).expect("OP");
    ecm.servo_on(&[1]).expect("it is on");
    let mut stream = ecm.stream(8).expect("a stream");
    // Until the alarm.
    assert!((0..40_000).any(|target| stream.csp(1, target).and_then(|()| stream.step().map(drop)).is_err()));
    drop(stream);
    let now = run(["summary", "--json", text(&flight)]);
    assert_eq!(now.code, Some(0), "{now:?}");
    drop(ecm);
    let found = json(&[text(&flight)]);
    let names = of_parts(&found, "name");
    assert!(
        names.len() >= 2 && names.iter().all(|name| name.as_str().expect("a name").starts_with("segment-")),
        "{names:?}"
    );
    let alarms: u64 = of_parts(&found, "alarms").iter().map(|alarms| alarms.as_u64().expect("a number")).sum();
    assert_eq!(alarms, 1);
    assert_eq!(found["passed_over"], serde_json::json!([]));
}
