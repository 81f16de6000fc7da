//! Ctrl-C and other signals, on the real clock: moving axes are braked on their line and stay on, and nothing hangs.
#![cfg(target_os = "linux")]

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Stdio};
use std::time::Duration;

use crate::common::board::{RecordedTraffic, SIZE, file, text};
use crate::common::{ecmsk, with_default_signals};
use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use ecmsk::sk::{CommandId, MasterState};
use rustix::process::{Pid, Signal, kill_process};

/// The running tool, and what it prints on standard error.
struct Work {
    child: Child,
    said: BufReader<ChildStderr>,
    /// What the test has read from standard error so far.
    err: String,
}

impl Work {
    fn start(words: &[&str]) -> Self {
        let mut command = with_default_signals(&ecmsk(words));
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the tool starts");
        let said = BufReader::new(child.stderr.take().expect("a pipe"));
        Self { child, said, err: String::new() }
    }

    /// Reads standard error until a line contains these words.
    fn until(&mut self, words: &str) {
        let before = self.err.len();
        while !self.err[before..].contains(words) {
            let read = self.said.read_line(&mut self.err).expect("UTF-8");
            assert!(read > 0, "it ended without `{words}`: {}", self.err);
        }
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).expect("it runs");
    }

    /// Sends a signal twice, as bash and the system send SIGHUP when a terminal is closed: 0.5 ms apart.
    fn signal_twice(&self, signal: Signal) {
        self.signal(signal);
        until_delivered(&self.child);
        std::thread::sleep(Duration::from_micros(500));
        self.signal(signal);
    }

    /// Stops the tool for longer than the frames in the board's FIFO last. `meanwhile` gets it while it stands.
    fn stall(&self, meanwhile: impl FnOnce(&Self)) {
        self.signal(Signal::STOP);
        std::thread::sleep(STALL);
        meanwhile(self);
        self.signal(Signal::CONT);
    }

    /// Waits for the tool's end; returns its exit code and all of its standard error.
    fn end(mut self) -> (Option<i32>, String) {
        self.said.read_to_string(&mut self.err).expect("UTF-8");
        (self.child.wait().expect("it ends").code(), self.err)
    }
}

/// How long a test stops the tool.
pub(super) const STALL: Duration = Duration::from_millis(600);

/// Waits until the process has got all signals: a second signal of a kind that is still pending would be lost.
pub(super) fn until_delivered(process: &Child) {
    let status = format!("/proc/{}/status", process.id());
    let pending =
        |line: &str| line.strip_prefix("ShdPnd:").is_some_and(|mask| !mask.trim().trim_matches('0').is_empty());
    while std::fs::read_to_string(&status).expect("it runs").lines().skip(1).any(pending) {
        std::thread::yield_now();
    }
}

/// Asserts that the tool, which was stopped while slave 1 moved, sets the axis in motion no more: after the stall all its
/// targets are the last one before it. One more may have been on its way when the tool was stopped.
#[track_caller]
pub(super) fn expect_rest_after_the_stall(file: &Path) {
    let mut targets = Vec::new();
    for recorded in Recording::open(file).expect("the recording") {
        let recorded = recorded.expect("a frame");
        let slot = recorded.frame.slot(SIZE, 1);
        if recorded.dir == Dir::Write && slot.id == CommandId::Csp.code() {
            targets.push((recorded.at_ns, slot.data1 as i32));
        }
    }
    let start = targets[0].1;
    let moves = targets.iter().position(|(_, target)| *target != start).expect("it moved");
    let moving = &targets[moves - 1..];
    let is_stall = |pair: &[(u64, i32)]| u128::from(pair[1].0 - pair[0].0) > STALL.as_nanos() / 2;
    // If it has sent nothing after the stall, that was after its last target.
    let stall = moving.windows(2).position(is_stall).unwrap_or(moving.len() - 1);
    let mut after: Vec<i32> = moving[stall..].iter().map(|(_, target)| *target).collect();
    after.dedup();
    assert!(after.len() <= 2, "it goes on, from {} to {:?}", after[0], after.last());
    // On a machine that was late the brake may have been over before the stall.
    if stall > 0 && (moving[stall].1 - moving[stall - 1].1).abs() <= 1 {
        eprintln!("this machine was late: the axis stood already when the tool was stopped");
    }
}

fn recorded(name: &str, keys: &str) -> (String, PathBuf) {
    let file = file(name);
    (format!("sim:?{keys}&record={}", file.display()), file)
}

/// The note of a machine so late that the axes stood: their brake is cut then.
const LATE: &str = "note: this process was late";

/// The steps from each target to the next, and the changes from each step to the next.
fn steps(targets: &[i32]) -> (Vec<i32>, Vec<i32>) {
    let differences = |of: &[i32]| of.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<_>>();
    let steps = differences(targets);
    let changes = differences(&steps);
    (steps, changes)
}

/// Ctrl-C in a move brakes both axes on their line with the move's own acceleration; they stay on, in OP.
/// The exit code is 130, of SIGTERM 143.
#[test]
fn ctrl_c_brakes_a_move() {
    for (name, signal, code, why) in
        [("int", Signal::INT, 130, "stopped by Ctrl-C"), ("term", Signal::TERM, 143, "stopped by SIGTERM")]
    {
        let (board, file) = recorded(name, "slaves=drive*2");
        let line = ["move", "1=900000", "2=-300000", "--velocity", "100000", "--acceleration", "200000"];
        let mut work = Work::start(&[&line[..], &["--up", "--link", &board]].concat());
        work.until("progress: moving");
        work.signal(signal);
        let (ended, said) = work.end();
        assert_eq!(ended, Some(code), "{said}");
        if said.contains(LATE) {
            continue;
        }
        assert!(
            said.contains(&format!("error: {why}; no axis moves, those that were on stay on; run it again")),
            "{said}"
        );

        let tape = RecordedTraffic::read(&file);
        let (first, second) = (tape.targets(1), tape.targets(2));
        let (speed, change) = steps(&first);
        // At full speed the step is 100 counts a cycle. With the move's acceleration it changes by 0.2 counts a cycle; rounding
        // adds up to a count.
        assert!(speed.contains(&100) && speed.iter().all(|step| (0..=101).contains(step)), "it moved, and never back");
        assert!(change.iter().all(|change| change.abs() <= 2), "{change:?}");
        assert!(speed.ends_with(&[0]) || speed.ends_with(&[1]), "it came to rest: {:?}", &speed[speed.len() - 5..]);
        let full = speed.iter().rposition(|step| *step >= 99).expect("it was fast");
        // The axis brakes in 0.6 s: 0.1 s until full deceleration, 0.4 s with it, and 0.1 s until it has ended.
        let brake: Vec<i32> = speed[full..].windows(101).map(|window| window[0] - window[100]).collect();
        assert!(brake.iter().all(|change| *change <= 22) && brake.iter().any(|change| *change >= 18), "{brake:?}");
        assert!(speed.len() - full <= 800, "{} frames to rest", speed.len() - full);
        assert!(*first.last().unwrap() < 900_000);
        for (a, b) in first.iter().zip(&second) {
            assert!((f64::from(*b) + f64::from(*a) / 3.0).abs() <= 1.0, "off the line: {a}, {b}");
        }
        assert_eq!(tape.state(), Some(MasterState::Op));
        assert!(tape.is_on(1) && tape.is_on(2));
        assert!(tape.last(1).position.abs_diff(*first.last().unwrap()) <= 2, "it stands where it was told to");
    }
}

/// If braking with the move's own acceleration would take longer than 1.5 s, the move brakes harder and is at rest within that
/// time.
#[test]
fn a_slow_brake_is_cut_short() {
    let (board, file) = recorded("slow", "slaves=drive");
    let line = ["move", "1=9000000", "--velocity", "100000", "--acceleration", "25000"];
    let mut work = Work::start(&[&line[..], &["--up", "--link", &board]].concat());
    work.until("progress: moving");
    work.until("progress: moving");
    work.signal(Signal::INT);
    let (ended, said) = work.end();
    assert_eq!(ended, Some(130), "{said}");
    if said.contains(LATE) {
        return;
    }
    let tape = RecordedTraffic::read(&file);
    let (speed, change) = steps(&tape.targets(1));
    let fastest = speed.iter().position(|step| step == speed.iter().max().unwrap()).unwrap();
    assert!(speed[fastest] > 25 && change.iter().all(|change| change.abs() <= 2));
    assert!(speed.len() - fastest <= 1700, "{} frames to rest", speed.len() - fastest);
    assert!(tape.is_on(1) && *speed.last().unwrap() <= 1);
}

/// A move whose process is stopped (SIGSTOP) until the FIFO is empty goes on from rest, with the move's own
/// acceleration, to its end and no further.
#[test]
fn a_move_that_stands_still_goes_on_from_rest() {
    const END: i32 = 200_000;
    let (board, file) = recorded("stands-still", "slaves=drive");
    let line = ["move", &format!("1={END}"), "--velocity", "100000", "--acceleration", "200000"];
    let mut work = Work::start(&[&line[..], &["--up", "--link", &board]].concat());
    work.until("progress: moving");
    work.stall(|_| ());
    let (ended, said) = work.end();
    assert_eq!(ended, Some(0), "{said}");
    assert!(said.contains("note: this process was late, and the axes stood: they go on from rest"), "{said}");

    let tape = RecordedTraffic::read(&file);
    let targets = tape.targets(1);
    let (speed, change) = steps(&targets);
    assert!(speed.iter().all(|step| (0..=101).contains(step)), "never back, and never faster");
    assert!(change.iter().all(|change| *change <= 2), "it never gets faster at once: {change:?}");
    assert!(change.iter().any(|change| *change < -10), "it stood");
    assert_eq!(targets.last(), Some(&END));
    assert!(tape.positions(1).iter().all(|at| *at <= END + 2), "the drive makes up for its lag");
}

/// A second Ctrl-C ends the program at once.
#[test]
fn a_second_ctrl_c_leaves() {
    let (board, _) = recorded("twice", "slaves=drive");
    let line = ["move", "1=9000000", "--velocity", "100000", "--acceleration", "25000"];
    let mut work = Work::start(&[&line[..], &["--up", "--link", &board]].concat());
    work.until("progress: moving");
    work.until("progress: moving");
    work.signal(Signal::INT);
    until_delivered(&work.child);
    // The axis brakes for 1.5 s from here on; the second signal comes before the end of that.
    work.signal(Signal::INT);
    let (code, said) = work.end();
    assert_eq!(code, Some(130));
    assert!(!said.contains("stopped by"), "it had no time to say so: {said}");
}

/// A terminal that is closed sends SIGHUP twice: the move brakes all the same. SIGQUIT (Ctrl-\) brakes it as well.
#[test]
fn two_hangups_and_a_quit_brake_a_move() {
    for (signal, code, why) in [(Signal::HUP, 129, "stopped by SIGHUP"), (Signal::QUIT, 131, "stopped by SIGQUIT")] {
        let (board, file) = recorded(&format!("closed-{code}"), "slaves=drive");
        let line = ["move", "1=9000000", "--velocity", "100000", "--acceleration", "200000"];
        let mut work = Work::start(&[&line[..], &["--up", "--link", &board]].concat());
        work.until("progress: moving");
        if signal == Signal::HUP {
            work.signal_twice(signal)
        } else {
            work.signal(signal)
        }
        let (ended, said) = work.end();
        assert_eq!(ended, Some(code), "{said}");
        assert!(said.contains(&format!("error: {why}; no axis moves, those that were on stay on")), "{said}");
        if said.contains(LATE) {
            continue;
        }
        let tape = RecordedTraffic::read(&file);
        let (speed, change) = steps(&tape.targets(1));
        assert!(speed.contains(&100) && change.iter().all(|change| change.abs() <= 2), "{change:?}");
        assert!(*speed.last().unwrap() <= 1 && tape.is_on(1), "it came to rest");
    }
}

/// docs/SAFETY.md: a process that is stopped (SIGSTOP) until the FIFO is empty brakes no axis that stands. Ctrl-C comes before
/// the stall or within it.
#[test]
fn a_brake_that_stalls_starts_no_axis() {
    for stalled_first in [true, false] {
        let (board, file) = recorded(&format!("stalled-first-{stalled_first}"), "slaves=drive");
        let line = ["move", "1=9000000", "--velocity", "100000", "--acceleration", "80000"];
        let mut work = Work::start(&[&line[..], &["--up", "--link", &board]].concat());
        work.until("progress: moving");
        work.until("progress: moving");
        if stalled_first {
            work.stall(|work| work.signal(Signal::INT));
        } else {
            work.signal(Signal::INT);
            // The brake takes 1.3 s.
            std::thread::sleep(Duration::from_millis(150));
            work.stall(|_| ());
        }
        let (ended, said) = work.end();
        assert_eq!(ended, Some(130), "{said}");
        assert!(said.contains("error: stopped by Ctrl-C; no axis moves, those that were on stay on"), "{said}");
        expect_rest_after_the_stall(&file);
    }
}

/// Ctrl-C ends homing with ABORT_HOME; the axis stands and stays on. So does a terminal that is closed, which sends SIGHUP
/// twice.
#[test]
fn ctrl_c_aborts_homing() {
    for (signal, code) in [(Signal::INT, 130), (Signal::HUP, 129)] {
        let (board, file) = recorded(&format!("home-{code}"), "slaves=drive*2");
        let mut work = Work::start(&["home", "2", "--method", "1", "--up", "--link", &board]);
        work.until("progress: homing axis 2: moving");
        if signal == Signal::HUP {
            work.signal_twice(signal)
        } else {
            work.signal(signal)
        }
        let (ended, said) = work.end();
        assert_eq!(ended, Some(code), "{said}");
        assert!(said.ends_with("run it again to go on\n"), "{said}");
        let tape = RecordedTraffic::read(&file);
        assert!(tape.sent(2, CommandId::GoHome) && tape.sent(2, CommandId::AbortHome));
        let positions = tape.positions(2);
        let rest = &positions[positions.len() - 3..];
        assert!(rest[0] < -1000 && rest.iter().all(|position| position.abs_diff(rest[0]) <= 2), "{rest:?}");
        assert!(tape.is_on(2) && !tape.is_on(1));
    }
}

/// Ctrl-C ends every wait: a change of state that hangs, an SDO without answer, `wait`.
#[test]
fn ctrl_c_ends_every_wait() {
    let events = text("hangs.ecmscript", "sdo-delay 1 1000s\nmute 1\n");
    let hangs = format!("sim:?slaves=drive&script={events}&state_timeout_ms=3600000&sdo_timeout_ms=3600000");
    for line in [
        &["state", "op", "--timeout", "1h", "--link", &hangs][..],
        &["state", "op", "--timeout", "3600s", "--link", &hangs],
        &["sdo", "read", "1", "statusword", "--timeout", "3600", "--link", &hangs],
        &["run", "-", "--link", "sim:?slaves=drive"],
    ] {
        let mut work = if line[0] == "run" { waiting_script(line) } else { Work::start(line) };
        if line.contains(&"1h") {
            assert_eq!(work.end().0, Some(2), "a wrong time");
            continue;
        }
        work.until("progress: ");
        work.signal(Signal::INT);
        let (code, said) = work.end();
        assert_eq!(code, Some(130), "{line:?}: {said}");
    }
}

fn waiting_script(line: &[&str]) -> Work {
    let script = text("wait.ecm", "state op\nservo on 1\nwait 3600s\n");
    Work::start(&["run", &script, line[2], line[3]])
}

/// A board that falls silent ends a move; the error says what to do.
#[test]
fn a_silent_board_ends_a_move_with_the_next_step() {
    let events = text("silent.ecmscript", "at 900ms silent\n");
    let (board, _) = recorded("silent", &format!("slaves=drive&clock=virtual&script={events}"));
    let (code, said) = Work::start(&["move", "1=900000", "--velocity", "100000", "--up", "--link", &board]).end();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.lines().any(|line| line.starts_with("error: ") && line.contains("check the cable")), "{said}");
}
