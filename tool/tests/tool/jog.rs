//! `ecmsk jog` on a terminal: an axis runs while its key is held, and stands however it ends.
#![cfg(target_os = "linux")]

use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use crate::common::board::{file, text};
use crate::common::run;
use crate::monitor_terminal::{Terminal, ends};
use crate::stop::{STALL, expect_rest_after_the_stall, until_delivered};
use ecmsk::ecm::{Config, Ecm};
use ecmsk::port::tcp::Server;
use rustix::process::Signal;
use rustix::termios::{Action, tcflow};
use support::tcp::{LIMIT, Told, serve, until, uri};

const RIGHT: &[u8] = b"\x1b[C";
const LEFT: &[u8] = b"\x1b[D";
/// The speed of the axis, counts/s.
const SPEED: i32 = 20_000;
/// The interval at which a keyboard repeats a key.
const REPEAT: Duration = Duration::from_millis(30);

/// A served board, a reader of it, and `ecmsk jog 1` on a terminal.
struct Hand {
    jog: Terminal,
    reader: Ecm,
    _server: Server,
    _told: Told,
}

impl Hand {
    fn start() -> Self {
        Self::start_with(&["1", "--machine", "none", "--velocity", &SPEED.to_string()], b"")
    }

    /// Starts `ecmsk jog` with these words. The keys are typed before it reads any.
    fn start_with(words: &[&str], keys: &[u8]) -> Self {
        let (server, told) = serve("sim:?slaves=drive*2");
        let link = uri(&server, "");
        let mut jog = Terminal::start(&[&["jog"], words, &["--up", "--link", &link]].concat());
        jog.type_keys(keys);
        jog.until("its keys", |screen| screen.contents().contains("any other key stops"));
        let reader = Ecm::open(&uri(&server, "role=reader")).unwrap();
        reader.adopt(&Config::drives(2)).unwrap();
        Self { jog, reader, _server: server, _told: told }
    }

    fn position(&self) -> i32 {
        self.reader.next_cycle(LIMIT).unwrap().position(1).unwrap()
    }

    /// Holds a key until the axis has moved further than `way`.
    fn hold(&mut self, key: &[u8], way: i32) {
        let (from, began) = (self.position(), Instant::now());
        while self.position().abs_diff(from) < way.unsigned_abs() {
            assert!(began.elapsed() < LIMIT, "it does not move");
            self.jog.type_keys(key);
            thread::sleep(REPEAT);
        }
    }

    /// Holds a key until the line on the screen has these words.
    fn hold_until(&mut self, key: &[u8], words: &str) {
        let began = Instant::now();
        while !self.jog.text().contains(words) {
            assert!(began.elapsed() < LIMIT, "never: {words}\n{}", self.jog.text());
            self.jog.type_keys(key);
            thread::sleep(REPEAT);
        }
    }

    /// Waits until the axis stands; returns its position.
    fn stands(&self) -> i32 {
        let began = Instant::now();
        loop {
            let from = self.position();
            let moved = (0..200).map(|_| self.position().abs_diff(from)).max().unwrap();
            if moved <= 2 {
                return self.position();
            }
            assert!(began.elapsed() < LIMIT, "it goes on");
        }
    }

    fn is_on(&self) -> bool {
        self.reader.snapshot().unwrap().drive(1).unwrap().statusword.is_enabled()
    }
}

/// docs/SAFETY.md: an axis runs while its key is held, in both directions, and stands when the key is released. `q` ends the
/// verb, and the terminal is as before.
#[test]
fn an_axis_runs_while_its_key_is_held() {
    let mut hand = Hand::start();
    // 400 ms at that speed.
    assert!(hand.jog.text().contains("one tap of a key moves axis 1 by about 8"), "{}", hand.jog.text());
    let start = hand.stands();
    hand.hold(RIGHT, SPEED / 4);
    let there = hand.stands();
    assert!(there - start >= SPEED / 4, "{start} {there}");
    hand.jog.until("its state", |screen| {
        let text = screen.contents();
        text.contains("axis 1: stands at ") && text.contains("following error") && text.contains("Operation enabled")
    });
    hand.hold(LEFT, SPEED / 4);
    assert!(hand.stands() < there);
    // Ctrl-\ is a key as well, and sends no SIGQUIT.
    for key in [b" ", b"\x1c"] {
        hand.hold(RIGHT, 100);
        hand.jog.type_keys(key);
        hand.stands();
        assert!(hand.is_on());
    }
    hand.jog.type_keys(b"q");
    assert_eq!(hand.jog.ended(), Some(0));
}

/// docs/SAFETY.md: keys that a line delivers all at once do not move the axis as if each of them had been held.
#[test]
fn keys_that_arrive_all_at_once_begin_no_motion() {
    let mut hand = Hand::start();
    let start = hand.stands();
    // Held, these keys would be ten seconds.
    hand.jog.type_keys(&RIGHT.repeat(300));
    thread::sleep(Duration::from_millis(200));
    let moved = hand.stands() - start;
    assert!(moved < SPEED, "{moved}: it ran for longer than a key allows");
    hand.hold(RIGHT, 100);
    hand.jog.type_keys(b"q");
    assert_eq!(hand.jog.ended(), Some(0));
}

/// docs/SAFETY.md: a key that was typed before the keys are read moves no axis when there is no hand on the keyboard any more.
#[test]
fn a_key_typed_too_early_begins_no_motion() {
    let mut hand = Hand::start_with(&["1", "--machine", "none", "--velocity", &SPEED.to_string()], RIGHT);
    // A key moves the axis by 8,000 counts.
    let start = hand.position();
    thread::sleep(Duration::from_millis(300));
    let moved = hand.stands() - start;
    assert!(moved.abs() <= 2 && start.abs() <= 2, "{start}, {moved}");
    hand.hold(RIGHT, 100);
    hand.jog.type_keys(b"q");
    assert_eq!(hand.jog.ended(), Some(0));
}

/// The key of the positive direction moves an axis to greater positions in its unit, also where its counts fall. A limit has
/// the name that it has in the machine file.
#[test]
fn a_negative_scale_turns_the_keys() {
    let speed = (SPEED / 10).to_string();
    let mut hand = Hand::start_with(&["1", "--machine", "none", "--velocity", &speed, "--counts-per-unit=-10"], b"");
    let start = hand.stands();
    hand.hold(RIGHT, 1000);
    assert!(hand.stands() < start - 900);
    hand.jog.type_keys(b"q");
    assert_eq!(hand.jog.ended(), Some(0));

    let axis = "format = 1\n[axes]\nZ = { slave = 1, unit = \"mm\", per = -0.001, min = -2, max = 1 }\n[slaves.2]\nkind = \"drive\"\n";
    let machine = text("jog-turned.toml", axis);
    let mut hand = Hand::start_with(&["Z", "--machine", &machine, "--velocity", "10"], b"");
    hand.hold_until(b"+", "axis Z: stands at its limit, max = 1.000 mm,");
    assert!(hand.stands().abs_diff(-1000) <= 2);
    hand.hold_until(LEFT, "axis Z: stands at its limit, min = -2.000 mm,");
    assert!(hand.stands().abs_diff(2000) <= 2);
    hand.jog.type_keys(b"q");
    assert_eq!(hand.jog.ended(), Some(0));
}

/// TOOL-20 With `--guard` an axis goes no further from where it began, within the limits of the machine file.
#[test]
fn a_guard_limits_the_way() {
    let axis =
        "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.001, max = 0.5 }\n[slaves.2]\nkind = \"drive\"\n";
    let machine = text("jog-guarded.toml", axis);
    let mut hand = Hand::start_with(&["X", "--machine", &machine, "--velocity", "10", "--guard", "1500"], b"");
    hand.hold_until(RIGHT, "axis X: stands at its limit, max = 0.500 mm,");
    assert!(hand.stands().abs_diff(500) <= 2);
    hand.hold_until(LEFT, "axis X: stands 1500 counts from its start, see --guard,");
    assert!(hand.stands().abs_diff(-1500) <= 2);
    hand.jog.type_keys(b"q");
    assert_eq!(hand.jog.ended(), Some(0));
}

/// TOOL-20 A speed at which targets run further ahead of the axis than its lead limit is refused before anything is sent.
#[test]
fn a_speed_beyond_the_lead_limit_is_refused() {
    let link = "sim:?slaves=drive&clock=virtual";
    let tool = Terminal::start(&["jog", "1", "--machine", "none", "--velocity", "41900000", "--up", "--link", link]);
    tool.until("the reason", |screen| {
        let text = screen.contents().split_whitespace().collect::<Vec<_>>().join(" ");
        text.contains("runs 2681600 counts ahead of it") && text.contains("lower --velocity, or widen --lead-limit")
    });
    assert_eq!(tool.ended(), Some(1));
}

/// docs/SAFETY.md: a terminal that is closed sends SIGHUP twice, 0.5 ms apart: the axis is braked all the same, and stays on.
#[test]
fn two_hangups_brake_the_axis() {
    let mut hand = Hand::start();
    hand.hold(RIGHT, SPEED / 2);
    hand.jog.signal(Signal::HUP);
    until_delivered(&hand.jog.tool);
    thread::sleep(Duration::from_micros(500));
    hand.jog.signal(Signal::HUP);
    hand.jog.until("its end", |screen| screen.contents().contains("stopped by SIGHUP; no axis moves"));
    hand.stands();
    assert!(hand.is_on());
    assert_eq!(hand.jog.ended(), Some(129));
}

/// docs/SAFETY.md: Ctrl-C for a process that is stopped (SIGSTOP) until the FIFO is empty starts no axis again.
#[test]
fn a_process_that_stalls_starts_no_axis() {
    let file = file("jog-stall");
    let record = file.display().to_string();
    let words = ["jog", "1", "--machine", "none", "--velocity", "20000", "--up"];
    let board = ["--link", "sim:?slaves=drive", "--record", &record, "--overwrite"];
    let mut tool = Terminal::start(&[&words[..], &board].concat());
    tool.until("its keys", |screen| screen.contents().contains("any other key stops"));
    let began = Instant::now();
    // The line is drawn after the first second.
    while !tool.text().contains("axis 1: runs at ") {
        assert!(began.elapsed() < LIMIT, "never: {}", tool.text());
        tool.type_keys(RIGHT);
        thread::sleep(REPEAT);
    }
    tool.signal(Signal::STOP);
    thread::sleep(STALL);
    tool.signal(Signal::INT);
    tool.signal(Signal::CONT);
    assert_eq!(tool.ended(), Some(130));
    expect_rest_after_the_stall(&file);
}

/// docs/SAFETY.md: SIGTERM, Ctrl-C, SIGHUP and a closed terminal end the verb; the axis stands, and stays on.
#[test]
fn signals_and_a_closed_terminal_brake_the_axis() {
    for (signal, code) in [(Some(Signal::TERM), 143), (Some(Signal::HUP), 129), (None, 130)] {
        let mut hand = Hand::start();
        hand.hold(RIGHT, 100);
        match signal {
            Some(signal) => hand.jog.signal(signal),
            None => hand.jog.type_keys(b"\x03"),
        }
        hand.stands();
        assert!(hand.is_on(), "{signal:?}");
        assert_eq!(hand.jog.ended(), Some(code), "{signal:?}");
    }
    let mut hand = Hand::start();
    hand.hold(RIGHT, 100);
    let Hand { jog, reader, _server, _told } = hand;
    let mut tool = jog.hang_up();
    assert_eq!(ends(&mut tool), Some(129));
    let position = || reader.next_cycle(LIMIT).unwrap().position(1).unwrap();
    // Reports of before the end may still wait to be read.
    until("a standstill", || {
        let from = position();
        (0..200).all(|_| position().abs_diff(from) <= 2).then_some(())
    });
}

/// A terminal that takes no output holds nothing up: with `--any-line` the axis runs and stands by its key, and SIGTERM ends
/// the verb.
#[test]
fn drawing_holds_no_motion_up() {
    let words = ["1", "--machine", "none", "--velocity", "20000", "--any-line"];
    let mut hand = Hand::start_with(&words, b"");
    tcflow(&hand.jog.line, Action::OOff).unwrap();
    hand.hold(RIGHT, SPEED / 4);
    hand.stands();
    hand.jog.signal(Signal::TERM);
    assert_eq!(ends(&mut hand.jog.tool), Some(143));
    hand.stands();
}

/// docs/SAFETY.md: when the terminal answers no more, the line may be late: the key that is held moves the axis no further.
#[test]
fn a_line_without_answers_ends_the_motion() {
    let mut hand = Hand::start();
    hand.hold(RIGHT, SPEED / 4);
    hand.jog.answers.store(false, Ordering::Relaxed);
    let hold_on = |hand: &mut Hand| {
        for _ in 0..30 {
            hand.jog.type_keys(RIGHT);
            thread::sleep(REPEAT);
        }
    };
    hold_on(&mut hand);
    let stands = hand.stands();
    hold_on(&mut hand);
    assert!(hand.stands().abs_diff(stands) <= 2);
    hand.jog.until("why", |screen| screen.contents().contains("keys come late and do not count"));
    hand.jog.type_keys(b"q");
    assert_eq!(hand.jog.ended(), Some(0));
}

/// A terminal that does not answer at all is refused, unless its line may be any one.
#[test]
fn a_terminal_without_answers_is_refused() {
    let words = ["jog", "1", "--machine", "none", "--up", "--link", "sim:?slaves=drive"];
    let tool = Terminal::start(&words);
    tool.answers.store(false, Ordering::Relaxed);
    tool.until("the reason", |screen| {
        let text = screen.contents().split_whitespace().collect::<Vec<_>>().join(" ");
        text.contains("the terminal does not answer") && text.contains("or add --any-line")
    });
    assert_eq!(tool.ended(), Some(1));
}

/// Without a terminal there is no hand: the verb refuses to begin.
#[test]
fn without_a_terminal_it_does_not_begin() {
    run(["jog", "1", "--up", "--link", "sim:?slaves=drive"]).expect_failure(
        1,
        &["have to be a terminal"],
        "`ecmsk move`",
    );
    run(["jog", "--link", "sim:"]).expect_misuse(&["<AXIS>"]);
    run(["jog", "1", "--repeat", "5s"]).expect_misuse(&["allowed: 30ms to 2s"]);
}
