//! `ecmsk jog` on a terminal: an axis runs while its key is held, and stands however it ends.
#![cfg(target_os = "linux")]

use std::thread;
use std::time::{Duration, Instant};

use crate::common::run;
use crate::monitor_terminal::{Terminal, ends};
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
        let (server, told) = serve("sim:?slaves=drive*2");
        let link = uri(&server, "");
        let speed = SPEED.to_string();
        let words = ["jog", "1", "--velocity", &speed, "--up", "--machine", "none", "--link", &link];
        let jog = Terminal::start(&words);
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
    hand.hold(RIGHT, 100);
    hand.jog.type_keys(b" ");
    hand.stands();
    assert!(hand.is_on());
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

/// A terminal that takes no output holds nothing up: the axis runs and stands by its key, and SIGTERM ends the verb.
#[test]
fn drawing_holds_no_motion_up() {
    let mut hand = Hand::start();
    tcflow(&hand.jog.line, Action::OOff).unwrap();
    hand.hold(RIGHT, SPEED / 4);
    hand.stands();
    hand.jog.signal(Signal::TERM);
    assert_eq!(ends(&mut hand.jog.tool), Some(143));
    hand.stands();
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
