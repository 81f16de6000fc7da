//! The limits of a machine file for programs, `axes=` with `program = "stop"`: what of a frame with a target beyond them reaches a
//! board.

use std::sync::Arc;
use std::time::Duration;

use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Options, Slave};
use ecmsk::link::{self, Dir, LinkError, Share};
use ecmsk::recording::Recording;
use ecmsk::sk::{CommandId, MasterState, SlotSize};
use tempfile::TempDir;

const FILE: &str = "\
format = 1
[slaves.2]
kind = \"drive\"
mode = \"csv\"
[axes]
X = { slave = 1, unit = \"mm\", per = 0.001, max = 20 }
[limits]
program = \"stop\"
";

/// The board of a test: axis 1 in CSP, with 20 mm = 20000 counts as its limit, and axis 2 in CSV.
struct Limited {
    folder: TempDir,
    uri: String,
}

impl Limited {
    fn new(name: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("machine.toml");
        std::fs::write(&file, FILE).unwrap();
        let uri = format!("sim:?slaves=drive*2&clock=virtual&name=limits-{name}&axes={}", file.display());
        Self { folder, uri }
    }

    fn config() -> Config {
        Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV)], ..Config::default() }
    }

    /// Both axes on.
    fn enabled(&self, keys: &str) -> Ecm {
        let link = link::open(&format!("{}{keys}", self.uri), Share::ByName).unwrap();
        let ecm = Ecm::over(Arc::clone(&link), Options::default()).unwrap();
        ecm.configure(&Self::config()).unwrap();
        ecm.set_state(MasterState::Op).unwrap();
        ecm.servo_on(&[1, 2]).unwrap();
        ecm
    }

    /// How far the two axes move in 100 cycles, counts, where the first one is, and whether they are on. The board is left as
    /// it is.
    fn look(&self) -> ([i32; 2], i32, [bool; 2]) {
        let options = Options { close: Close::Leave, ..Options::default() };
        let ecm = Ecm::open_with(&self.uri, options).unwrap();
        ecm.adopt(&Self::config()).unwrap();
        let first = ecm.snapshot().unwrap();
        let mut last = first.clone();
        (0..100).for_each(|_| last = ecm.next_cycle(Duration::from_secs(1)).unwrap());
        let moved = [1, 2].map(|axis| last.position(axis).unwrap() - first.position(axis).unwrap());
        let is_on = [1, 2].map(|axis| last.drive(axis).unwrap().statusword.is_enabled());
        (moved, last.position(1).unwrap(), is_on)
    }
}

fn is_beyond(error: &EcmError) -> bool {
    matches!(error, EcmError::Link(LinkError::BeyondLimit { .. }))
}

/// Axis 1 comes to its limit at full speed, and its next target is refused. It stops at the limit, and closing works on: axis 2 is
/// braked, and both are switched off.
#[test]
fn closing_stops_all_axes_at_a_limit_and_switches_them_off() {
    for (how, is_on) in [(Close::Hold, true), (Close::ServoOff, false)] {
        let board = Limited::new(&format!("close-{is_on}"));
        let ecm = board.enabled("");
        let mut stream = ecm.stream(16).unwrap();
        for target in (0..=20_000).step_by(50) {
            stream.csp(1, target).unwrap();
            stream.csv(2, 50_000).unwrap();
            stream.step().unwrap();
        }
        stream.csp(1, 20_050).unwrap();
        stream.csv(2, 60_000).unwrap();
        assert!(is_beyond(&stream.step().unwrap_err()));
        std::mem::forget(stream);
        ecm.close(how).unwrap();
        let (moved, position, on) = board.look();
        assert!(moved.iter().all(|counts| counts.abs() <= 2), "{how:?}: {moved:?}");
        assert!(position <= 20_005, "{how:?}: {position}");
        assert_eq!(on, [is_on; 2], "{how:?}");
    }
}

/// The first frame of a stream with a prefill has a wrong target: the board has got its threshold all the same. The end of the
/// stream discards what waits behind it, and is no time limit.
#[test]
fn a_stream_whose_first_frame_is_refused_ends_at_once() {
    let board = Limited::new("prefill");
    let ecm = board.enabled("");
    let mut stream = ecm.stream(16).unwrap();
    stream.prefill(8).unwrap();
    stream.csp(1, 20_001).unwrap();
    assert!(is_beyond(&stream.step().unwrap_err()));
    let began = ecm.snapshot().unwrap().meta.at.0;
    assert_eq!(stream.finish().unwrap().frames, 1);
    let ended = ecm.next_cycle(Duration::from_secs(1)).unwrap();
    assert!(ended.meta.at.0 - began < 100_000_000, "{} ns", ended.meta.at.0 - began);
    // The next one begins as usual.
    let mut stream = ecm.stream(16).unwrap();
    (0..100).for_each(|n| {
        stream.csp(1, n * 10).unwrap();
        stream.step().unwrap();
    });
    stream.finish().unwrap();
    let at = ecm.snapshot().unwrap().position(1).unwrap();
    assert!((at - 990).abs() < 20, "{at}");
    ecm.close(Close::Hold).unwrap();
}

/// A program that puts its wrong target into each frame, and does not look at results: what it sends beside the target reaches
/// the board, here a velocity of 0 and then SV_OFF. A recording has what was sent.
#[test]
fn a_program_that_goes_on_with_a_wrong_target_stops_and_switches_off() {
    let board = Limited::new("program");
    let record = board.folder.path().join("run.pcapng");
    let ecm = board.enabled(&format!("&record={}", record.display()));
    let mut stream = ecm.stream(16).unwrap();
    let position = || ecm.snapshot().unwrap().position(2).unwrap();
    for velocity in [50_000, 0] {
        for _ in 0..300 {
            stream.csp(1, 20_001).unwrap();
            stream.csv(2, velocity).unwrap();
            let error = stream.step().unwrap_err();
            assert!(is_beyond(&error), "{error}");
        }
        assert!(position() > 5_000);
    }
    drop(stream);
    ecm.servo_off(&[1, 2]).unwrap();
    ecm.close(Close::Leave).unwrap();
    let (moved, position, on) = board.look();
    assert!(moved.iter().all(|counts| counts.abs() <= 2) && position <= 20_005, "{moved:?} {position}");
    assert_eq!(on, [false; 2]);
    let frames = Recording::open(&record).unwrap().map(Result::unwrap).filter(|read| read.dir == Dir::Write);
    let slots: Vec<_> = frames.map(|read| [1, 2].map(|slave| read.frame.slot(SlotSize::Bytes12, slave))).collect();
    let is = |slot: &ecmsk::sk::RawSlot, id: CommandId| slot.id == id.code();
    assert!(slots.iter().all(|[x, _]| !is(x, CommandId::Csp) || x.data1 as i32 <= 20_000));
    let refused = slots.iter().filter(|[x, y]| !is(x, CommandId::Csp) && is(y, CommandId::Csv)).count();
    assert!(refused >= 600, "{refused}");
}

/// An axis that stands beyond its lower limit may come within its limits, and gets no target beyond the upper one for that.
#[test]
fn an_axis_below_its_limits_does_not_go_above_them() {
    let board = Limited::new("below");
    let file = board.folder.path().join("machine.toml");
    std::fs::write(&file, FILE.replace("max = 20", "min = 0.1, max = 0.2")).unwrap();
    let ecm = board.enabled("");
    let mut stream = ecm.stream(16).unwrap();
    for (target, is_sent) in
        [(10, true), (-50, false), (201, false), (299, false), (50, true), (200, true), (201, false)]
    {
        stream.csp(1, target).unwrap();
        let stepped = stream.step();
        assert_eq!(stepped.is_ok(), is_sent, "{target}");
        assert!(stepped.err().is_none_or(|error| is_beyond(&error)), "{target}");
    }
}
