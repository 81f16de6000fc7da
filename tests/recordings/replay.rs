//! The host's half of a recording, replayed on the model.

use std::path::Path;

use ecmsk::compare::{CompareOptions, Comparison, Deviation, Steps, TimedFrame, compare_steps};
use ecmsk::link::Dir;
use ecmsk::link::uri::LinkUri;
use ecmsk::recording::{RecordError, Recorded, Recording};
use ecmsk::replay::{FilesInLink, Replay, ReplayError};
use ecmsk::sk::{DriveResponse, Frame, MasterState, SlotSize, StateByte};
use support::captures::convert::{USB_LINUX, USBPCAP};
use support::captures::traffic::Traffic;
use support::captures::{captured, kept};
use support::recorded::{Program, SIZE};

const MODEL: &str = "sim:?slaves=drive*2,io";

fn link(text: &str) -> LinkUri {
    LinkUri::parse(text).expect("a link")
}

fn open(file: &Path, model: Option<&str>) -> Result<Replay, ReplayError> {
    Replay::open(file, model.map(link).as_ref(), &CompareOptions::default(), None, FilesInLink::Allowed)
}

fn compare(replay: &Replay) -> Comparison {
    let (board, model) = replay.runs().expect("both runs");
    let options = CompareOptions::default();
    compare_steps(Steps::new(board, replay.size(), false), Steps::new(model, replay.size(), false), &options)
}

/// Reports with their times.
fn reports(half: impl Iterator<Item = TimedFrame>) -> Vec<(i64, Vec<u8>)> {
    let reports = half.filter(|observed| observed.dir == Dir::Read);
    reports.map(|observed| (observed.at_ns, observed.frame.bytes().to_vec())).collect()
}

/// A recording of the model, replayed: the same reports at the same nanoseconds, with the slaves behind a chip, too.
/// The model is that of the recording unless another one is named.
#[test]
fn a_recording_of_the_model_is_its_replay() {
    for program in [
        Program::default(),
        Program { cycle_us: 500, ..Program::default() },
        Program { keys: "&host_us=400".into(), polls: 1, ..Program::default() },
        Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() },
        Program { scheme: "xf-sim", ..Program::default() },
        Program { scheme: "xf-sim", keys: "&chip_fw=old&ahead=20".into(), polls: 1, ..Program::default() },
    ] {
        let run = program.record();
        let replay = open(&run.file, None).expect("it is replayed");
        let (board, model) = replay.runs().expect("both runs");
        let (board, model) = (reports(board), reports(model));
        assert!(board.len() > 800, "{}", board.len());
        let first = board.iter().zip(&model).position(|(board, model)| board != model);
        assert_eq!((first, board.len()), (None, model.len()), "another report");
        let found = compare(&replay);
        // Behind a chip some cycles report two commands at once.
        assert!(found.is_equal() && found.answers > if program.scheme == "sim" { 300 } else { 250 }, "{found}");
    }
}

/// A model whose slaves are behind an ECM-XF can be recorded, and a recording can be replayed on it: each axis ends at
/// the same position. Its way to OP is longer than with its own slaves, so that frames recorded with those come too
/// early.
#[test]
fn a_model_behind_a_chip_is_replayed() {
    let run = Program { scheme: "xf-sim", short: true, ..Program::default() }.record();
    for other in [None, Some(MODEL)] {
        let replay = open(&run.file, other).expect("it is replayed");
        assert_eq!(replay.link().to_string().starts_with("xf-sim:"), other.is_none());
        let (board, model) = replay.runs().expect("both runs");
        let end = |half: Vec<(i64, Vec<u8>)>| {
            let (_, bytes) = half.last().cloned().expect("a report");
            let report = Frame::from_prefix(&bytes);
            [1, 2].map(|slave| DriveResponse::decode(&report.slot(SIZE, slave)).position)
        };
        let [board, model] = [end(reports(board)), end(reports(model))];
        assert!((0..2).all(|n| (board[n] - model[n]).abs() <= 2), "{board:?} {model:?}");
    }
    let run = Program::default().record();
    let replay = open(&run.file, Some(&MODEL.replace("sim:", "xf-sim:"))).expect("it is replayed");
    let found = compare(&replay);
    assert!(found.answers > 0 && !found.is_equal(), "{found}");
}

/// For a capture the computer's clock is aligned with the model's: reports come at the same time within a cycle.
#[test]
fn a_capture_is_replayed_cycle_by_cycle() {
    let run = Program { cycle_us: 500, ..Program::default() }.record();
    let traffic = captured(&run.file);
    for link_type in [USB_LINUX, USBPCAP] {
        let capture = kept(&traffic, link_type);
        let replay = open(&capture.file, Some(MODEL)).expect("it is replayed");
        let (board, model) = replay.runs().expect("both runs");
        let (board, model) = (reports(board), reports(model));
        assert!(board == model, "other reports");
        let found = compare(&replay);
        assert!(found.is_equal() && found.answers > 300, "{found}");
    }
}

/// Reports reach the computer with a varying delay after their cycle: the earliest ones determine the alignment.
#[test]
fn late_reports_are_no_difference() {
    // No command is in transit at the same time as a report: commands come at least 50 us after the end of a cycle.
    let run = Program { keys: "&host_us=150".into(), ..Program::default() }.record();
    let mut traffic = captured(&run.file);
    let capture = kept(&traffic, USB_LINUX);
    let in_time = *open(&capture.file, Some(MODEL)).expect("it is replayed").start();
    let mut late = (0..).map(|i: u64| [25, 10, 20, 30][i as usize % 4]);
    for event in traffic.events.iter_mut().filter(|event| event.endpoint == 0x81 && event.what == b'C') {
        event.at_us += late.next().expect("more");
    }
    traffic.events.sort_by_key(|event| event.at_us);
    let capture = kept(&traffic, USB_LINUX);
    let replay = open(&capture.file, Some(MODEL)).expect("it is replayed");
    let later_ns = replay.start().tick_ns - in_time.tick_ns;
    assert_eq!(later_ns.rem_euclid(1_000_000), 10_000, "{later_ns}");
    let (board, model) = replay.runs().expect("both runs");
    assert!(reports(board) == reports(model), "other reports");
    let found = compare(&replay);
    assert!(found.is_equal() && found.answers > 250, "{found}");
}

/// If the board acted differently, the first difference names the slot and the values.
#[test]
fn what_the_board_does_otherwise_is_found() {
    let run = Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() }.record();
    let capture = kept(&captured(&run.file), USB_LINUX);
    let found = compare(&open(&capture.file, Some(MODEL)).expect("it is replayed"));
    let first = found.first.as_ref().expect("a difference");
    assert_eq!(first.what[0].slave(), Some(2), "{first}");
    assert!(first.what.iter().any(|what| matches!(what, Deviation::ErrorCode { codes: [0x7500, 0], .. })), "{first}");
    // Another network, which does not reach OP.
    let found = compare(&open(&capture.file, Some("sim:?slaves=drive,io*2")).expect("it is replayed"));
    let first = found.first.expect("a difference");
    let states = [StateByte::reached(MasterState::Op), StateByte::failed(Some(MasterState::PreOp))];
    assert_eq!((first.command, &first.what[0]), (3, &Deviation::State { states }), "{first}");
}

/// The packets starting with the first report of that state.
fn from_state(traffic: &Traffic, state: MasterState) -> Traffic {
    let is = |event: &support::captures::convert::Event| {
        event.endpoint == 0x81 && event.data.as_ref().is_some_and(|data| data[2] == state.code())
    };
    let at = traffic.events.iter().position(is).expect("it gets there");
    Traffic { events: traffic.events[at..].to_vec(), ..Traffic::default() }
}

/// A capture that begins in OP cannot bring the model there: an error, or, if the program returns to PreOP, a replay
/// from there.
#[test]
fn a_capture_that_begins_in_the_middle() {
    let (long, short) = (Program::default().record(), Program { short: true, ..Program::default() }.record());
    let middle = from_state(&captured(&short.file), MasterState::Op);
    let error = open(&kept(&middle, USB_LINUX).file, Some(MODEL)).expect_err("it never leaves OP");
    let state = StateByte::reached(MasterState::Op);
    assert!(matches!(&error, ReplayError::NoStart { state: s, .. } if *s == state), "{error}");
    assert!(
        error.to_string().ends_with("begin the capture before the program starts, with the board just switched on")
    );

    // A command, the rest of OP, then the whole program once more.
    let mut middle = from_state(&captured(&long.file), MasterState::Op);
    let mut command = Traffic::default();
    command.write(7, &[0; 512]);
    for event in command.events.iter_mut().rev() {
        event.at_us = middle.events[0].at_us - 100;
        middle.events.insert(0, event.clone());
    }
    let later = middle.events.last().expect("an event").at_us + 1_000_000;
    let again = captured(&long.file);
    let first = again.events[0].at_us;
    middle.events.extend(again.events.into_iter().map(|mut event| {
        event.at_us = event.at_us - first + later;
        event.id += 1 << 20;
        event
    }));
    let capture = kept(&middle, USB_LINUX);
    let replay = open(&capture.file, Some(MODEL)).expect("it is replayed");
    let frames: Vec<_> = Recording::open(&capture.file).expect("a capture").map(Result::unwrap).collect();
    let is_start = |recorded: &Recorded| recorded.dir == Dir::Read && recorded.frame.bytes()[2] == 2;
    let before = frames.iter().position(is_start).expect("it goes back") as u64;
    assert!(before > 400 && frames[0].dir == Dir::Write);
    assert_eq!(replay.start().skipped, before);
    let found = compare(&replay);
    assert_eq!(found.counts[0].commands, found.counts[1].commands);
    assert!(found.counts[0].commands >= 304, "{found}");
}

/// A recording that cannot be replayed is an error with the reason and the next step.
#[test]
fn what_cannot_be_replayed() {
    let run = Program { short: true, ..Program::default() }.record();
    let traffic = captured(&run.file);
    let capture = kept(&traffic, USB_LINUX);
    let error = open(&capture.file, None).expect_err("which slaves?");
    assert!(matches!(error, ReplayError::NoModel { .. }) && error.to_string().contains("--link 'sim:"), "{error}");
    for link in ["usb:", "tcp://localhost:4711"] {
        let error = open(&capture.file, Some(link)).expect_err("no model");
        assert!(matches!(error, ReplayError::NotAModel { .. }), "{error}");
    }
    let error = open(&capture.file, Some("sim:?slaves=drive*2&record=model.pcapng")).expect_err("no recording is made");
    assert!(matches!(&error, ReplayError::Records { file, .. } if file == "model.pcapng"), "{error}");
    let error = open(&capture.file, Some("sim:?slaves=drive*2&slot=16")).expect_err("other slots");
    let expected = (SIZE, SlotSize::Bytes16);
    assert!(
        matches!(&error, ReplayError::SlotSizes { capture, model, .. } if (*capture, *model) == expected),
        "{error}"
    );

    let events = traffic.events.iter().filter(|event| event.endpoint == 0x02).cloned().collect();
    let commands = Traffic { events, ..Traffic::default() };
    let error = open(&kept(&commands, USB_LINUX).file, Some(MODEL)).expect_err("no report");
    assert!(matches!(error, ReplayError::NoReport { commands: 304, .. }), "{error}");
    let error = open(Path::new("no such file"), Some(MODEL)).expect_err("none");
    assert!(error.to_string().contains("check the path"), "{error}");
    let error = open(&kept(&Traffic::default(), USB_LINUX).file, Some(MODEL)).expect_err("empty");
    assert!(error.to_string().contains("while the program runs"), "{error}");
}

/// A truncated capture is replayed up to its end.
#[test]
fn a_capture_that_is_cut_off() {
    let run = Program::default().record();
    let capture = kept(&captured(&run.file), USBPCAP);
    let bytes = std::fs::read(&capture.file).expect("a file");
    std::fs::write(&capture.file, &bytes[..bytes.len() / 2 + 1]).expect("a file");
    let replay = open(&capture.file, Some(MODEL)).expect("it is replayed");
    let (mut board, model) = replay.runs().expect("both runs");
    let found =
        compare_steps(Steps::new(&mut board, SIZE, false), Steps::new(model, SIZE, false), &CompareOptions::default());
    assert!(found.is_equal() && found.counts[0].commands > 50, "{found}");
    assert!(matches!(board.damage(), Some(RecordError::Truncated { .. })), "{:?}", board.damage());
}
