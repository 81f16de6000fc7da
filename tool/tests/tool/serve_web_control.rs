//! `ecmsk serve web --control`: a page moves axes as long as it holds a button, and stops all of them.

mod needs_chromium;

use std::net::TcpStream;

use ecmsk::ecm::{Config, Ecm};
use serde_json::{Value, json};
use support::tcp::{LIMIT, until};
use tungstenite::{Message, WebSocket};

use crate::common::page::{Serving, next_text};
use crate::common::run;

/// How many messages a test reads before it gives up; a page that has control gets 24 of them a second.
const MESSAGES_MAX: usize = 5000;

/// A served board, its page with control, and a reader of the board.
pub struct Machine {
    pub board: Serving,
    pub web: Serving,
    pub reader: Ecm,
}

impl Machine {
    pub fn start() -> Self {
        let board = Serving::start("tcp", &["--link", "sim:?slaves=drive*2,io", "--machine", "none"]);
        let link = board.link();
        let web = Serving::start("web", &["--link", &link, "--control", "--machine", "none"]);
        let reader = Ecm::open(&format!("{link}?role=reader")).expect("a reader");
        reader.adopt(&Config::drives(2)).expect("two drives");
        Self { board, web, reader }
    }

    /// The position of axis 1 in the newest report, and the number of that.
    fn newest(&self) -> (i32, u64) {
        let snapshot = self.reader.snapshot().expect("a report");
        (snapshot.position(1).expect("a position"), snapshot.meta.sequence)
    }

    pub fn position(&self) -> i32 {
        self.newest().0
    }

    /// Waits until axis 1 stands for 200 cycles; returns its position.
    pub fn stands(&self) -> i32 {
        until("a standstill", || {
            let (from, begin) = self.newest();
            loop {
                match self.newest() {
                    (at, _) if at.abs_diff(from) > 2 => return None,
                    (_, now) if now >= begin + 200 => return Some(from),
                    _ => self.reader.next_cycle(LIMIT).map(drop).expect("a report"),
                }
            }
        })
    }

    pub fn end(self) {
        self.web.end();
        self.board.end();
    }
}

/// A page without a browser: a WebSocket that answers the questions of the server.
struct Hand {
    socket: WebSocket<TcpStream>,
    hold: Value,
    said: Vec<String>,
    presses: u32,
    has_control: bool,
}

impl Hand {
    fn of(machine: &Machine) -> Self {
        let socket = machine.web.socket().expect("a place");
        Self { socket, hold: Value::Null, said: Vec::new(), presses: 0, has_control: false }
    }

    fn send(&mut self, message: &Value) {
        self.socket.send(Message::text(message.to_string())).expect("it reads");
    }

    /// Answers questions until a message is as wanted; returns that. Fails after a number of messages that takes minutes.
    #[track_caller]
    fn wait(&mut self, mut is_it: impl FnMut(&Value) -> bool) -> Value {
        for _ in 0..MESSAGES_MAX {
            let message = next_text(&mut self.socket, &mut Vec::new());
            if message["type"] == "ask" {
                let answer = json!({"do": "alive", "n": message["n"], "hold": self.hold});
                self.send(&answer);
            }
            if message["type"] == "said" {
                self.said.push(message["text"].as_str().expect("a text").to_owned());
            }
            if message["type"] == "control" {
                self.has_control = message["holder"] == "you";
            }
            if is_it(&message) {
                return message;
            }
        }
        panic!("it never comes; the server has said {:?}", self.said);
    }

    #[track_caller]
    fn wait_for_holder(&mut self, holder: &str) {
        self.wait(|message| message["type"] == "control" && message["holder"] == holder);
    }

    /// Waits until the server says these words; returns whether it is an error.
    #[track_caller]
    fn wait_for(&mut self, words: &str) -> bool {
        let is_it = |message: &Value| message["text"].as_str().is_some_and(|text| text.contains(words));
        self.wait(|message| message["type"] == "said" && is_it(message))["is_error"] == true
    }

    /// Gives an order, and waits until the server says these words and the order is done; returns whether it is an error.
    #[track_caller]
    fn order(&mut self, order: &Value, words: &str) -> bool {
        self.send(order);
        let is_error = self.wait_for(words);
        self.wait(|message| message["type"] == "control" && message["busy"].is_null());
        is_error
    }

    /// Takes control, and switches axis 1 on.
    fn take(&mut self) {
        self.send(&json!({"do": "take"}));
        self.wait_for_holder("you");
        self.order(&json!({"do": "op"}), "OP");
        assert!(!self.order(&json!({"do": "on", "slave": 1}), "axis 1: on, Operation enabled"));
        // The first answer without a button.
        self.wait(|message| message["type"] == "ask");
    }

    /// Holds the button of axis 1 until that has moved by 500 counts. A late machine ends the motion or the control; then
    /// the button is pressed again.
    fn hold_until_it_moves(&mut self, machine: &Machine, is_positive: bool) {
        until("a motion", || {
            if !self.has_control {
                self.take();
            }
            let from = machine.position();
            self.presses += 1;
            self.hold = press(self.presses, is_positive);
            let moves = (0..60).any(|_| {
                self.wait(|message| ["ask", "control"].contains(&message["type"].as_str().expect("a type")));
                !self.has_control || machine.position().abs_diff(from) > 500
            });
            if moves && self.has_control {
                return Some(());
            }
            self.hold = Value::Null;
            None
        });
    }
}

fn press(number: u32, is_positive: bool) -> Value {
    json!({"press": number, "slave": 1, "is_positive": is_positive, "part": 1.0})
}

/// Waits until `stop` or another client can be the writer again.
fn is_free(machine: &Machine) {
    let link = machine.board.link();
    until("a free place", || {
        let said = run(["stop", "--json", "--machine", "none", "--link", &link]).expect_quiet();
        said.contains(r#""stopped":null"#).then_some(())
    });
}

/// docs/SAFETY.md: an axis runs as long as the page holds its button, and stands after the release. One press moves it
/// once: an answer that comes after the release, with the same press, moves nothing.
#[test]
fn an_axis_runs_while_its_button_is_held() {
    let machine = Machine::start();
    let mut hand = Hand::of(&machine);
    hand.take();
    let start = machine.stands();
    hand.hold_until_it_moves(&machine, true);
    hand.send(&json!({"do": "release"}));
    let there = machine.stands();
    assert!(there > start + 500);
    // It is still held, as a page that has missed the release would say.
    for _ in 0..20 {
        hand.wait(|message| message["type"] == "ask");
    }
    assert!(machine.stands().abs_diff(there) <= 2);
    hand.hold_until_it_moves(&machine, false);
    hand.hold = Value::Null;
    assert!(machine.stands() < there);
    machine.end();
}

/// A page reads and writes objects of slaves. What is no object, type or number is refused, and so is who has no control.
#[test]
fn a_page_reads_and_writes_objects() {
    let machine = Machine::start();
    let mut hand = Hand::of(&machine);
    let read = json!({"do": "read", "slave": 2, "object": "homing_method", "type": null});
    hand.send(&read);
    assert!(hand.wait_for("take control first"));
    hand.take();
    let write = |value: &str| json!({"do": "write", "slave": 2, "object": "0x6098", "type": "i8", "value": value});
    for (value, shown) in [("17", "sdo read 2 homing_method: 17 (0x11)"), ("-3", "sdo read 2 homing_method: -3 (0xFD)")]
    {
        assert!(!hand.order(&write(value), &format!("slave 2: homing_method (0x6098:0) = {value}")));
        assert!(!hand.order(&read, shown));
    }
    assert!(hand.order(&write("300"), "does not fit"));
    let unknown = json!({"do": "read", "slave": 2, "object": "0x5FFF", "type": "u16"});
    assert!(hand.order(&unknown, "0x06020000"));
    for wrong in ["homing_method 3", "0x6041\nmove 1=1000", "--help", ""] {
        hand.send(&json!({"do": "read", "slave": 1, "object": wrong, "type": null}));
        assert!(hand.wait_for("is one word"), "{wrong}");
    }
    assert!(!hand.order(&read, "-3 (0xFD)"));
    machine.end();
}

/// docs/SAFETY.md: a page that answers no more, and one whose connection ends, stop what they move; control ends, and
/// the axes stay on.
#[test]
fn a_page_that_is_silent_or_gone_stops_its_axis() {
    let machine = Machine::start();
    let mut hand = Hand::of(&machine);
    hand.take();
    hand.hold_until_it_moves(&machine, true);
    // From here on it answers nothing, and its connection stays.
    machine.stands();
    std::thread::sleep(std::time::Duration::from_millis(1500));
    hand.hold = Value::Null;
    hand.wait_for_holder("none");
    let said = hand.said.join("; ");
    assert!(
        said.contains("has answered nothing for a second, and has lost control; axes that were on stand"),
        "{said}"
    );

    hand.take();
    hand.hold_until_it_moves(&machine, true);
    drop(hand);
    machine.stands();
    is_free(&machine);
    assert!(machine.reader.snapshot().expect("a report").drive(1).expect("a drive").statusword.is_enabled());
    machine.end();
}

/// Any page stops all axes at once: those of the page that has control, which loses it, and those of another program.
#[test]
fn any_page_stops_whoever_moves() {
    let machine = Machine::start();
    let (mut hand, mut other) = (Hand::of(&machine), Hand::of(&machine));
    hand.take();
    hand.hold_until_it_moves(&machine, true);
    other.send(&json!({"do": "stop"}));
    machine.stands();
    hand.hold = Value::Null;
    hand.wait_for_holder("none");
    assert!(!other.wait_for("axes stand still"));

    let link = machine.board.link();
    let words = ["move", "1=100000000", "--velocity", "20000", "--yes", "--up", "--machine", "none", "--link", &link];
    let mut moving = crate::common::ecmsk(words).stderr(std::process::Stdio::null()).spawn().expect("it starts");
    let from = machine.position();
    until("a motion", || (machine.position().abs_diff(from) > 1000).then_some(()));
    // Control needs the place of the writer.
    other.send(&json!({"do": "take"}));
    assert!(other.wait_for("no control: "));
    other.send(&json!({"do": "stop"}));
    assert!(!other.wait_for(" was stopped"));
    machine.stands();
    assert_eq!(moving.wait().expect("it ends").code(), Some(1));
    machine.end();
}

/// One page has control. Another one asks for it, and gets it when the first one gives it up. Without control an order
/// does nothing but an error that says so.
#[test]
fn one_page_has_control_and_another_asks_for_it() {
    let machine = Machine::start();
    let (mut hand, mut other) = (Hand::of(&machine), Hand::of(&machine));
    hand.take();
    other.wait_for_holder("other");
    other.send(&json!({"do": "on", "slave": 2}));
    assert!(other.wait_for("take control first"));
    other.send(&json!({"do": "alive", "n": 1, "hold": press(1, true)}));
    other.send(&json!({"do": "take"}));
    hand.wait(|message| message["type"] == "control" && message["is_wanted"] == true);
    assert_eq!(machine.stands(), machine.position());
    hand.send(&json!({"do": "give"}));
    other.wait_for_holder("you");
    hand.wait_for_holder("other");
    other.send(&json!({"do": "off", "slave": 1}));
    assert!(!other.wait_for("axis 1: off"));
    machine.end();
}

/// What cannot be done is an error on the page, which says what to do; the page keeps control. Homing ends with `halt`.
#[test]
fn orders_are_done_or_refused_in_words() {
    let machine = Machine::start();
    let mut hand = Hand::of(&machine);
    hand.send(&json!({"do": "take"}));
    hand.wait_for_holder("you");
    hand.wait(|message| message["type"] == "ask");
    assert!(hand.order(&json!({"do": "home", "slave": 1}), "press Start network (OP) before it"));
    hand.order(&json!({"do": "op"}), "OP");
    hand.hold = press(1, true);
    assert!(hand.wait_for("press On of axis 1 before it"));
    hand.hold = Value::Null;
    hand.wait(|message| message["type"] == "ask");
    assert!(hand.order(&json!({"do": "on", "slave": 3}), "slave 3"));
    hand.send(&json!({"do": "dance"}));
    assert!(hand.wait_for("what this server does not know"));
    assert!(!hand.order(&json!({"do": "outputs", "slave": 3, "bits": 5}), "slave 3: outputs 0x0005"));
    assert!(hand.order(&json!({"do": "outputs", "slave": 0, "bits": 0x40}), "the board has six outputs"));
    hand.order(&json!({"do": "on", "slave": 1}), "axis 1: on");
    assert!(!hand.order(&json!({"do": "home", "slave": 1}), "axis 1: home found"));
    for part in [0.0, -1.0, 1.5] {
        let mut hold = press(2, true);
        hold["part"] = part.into();
        hand.hold = hold;
        hand.wait(|message| message["type"] == "ask");
        hand.wait(|message| message["type"] == "ask");
    }
    assert!(machine.stands().abs_diff(machine.position()) <= 2);
    machine.end();
}

/// The plus of the page is the plus of the unit that it shows: with a negative scale an axis goes to falling counts.
#[test]
fn plus_is_the_direction_of_the_unit() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("m.toml");
    let text = "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = -0.001 }\nY = { slave = 2, unit = \"mm\", per = 0.001 }\n";
    std::fs::write(&file, text).expect("a file");
    let board = Serving::start("tcp", &["--link", "sim:?slaves=drive*2", "--machine", file.to_str().expect("UTF-8")]);
    let link = board.link();
    let web = Serving::start("web", &["--link", &link, "--control"]);
    let reader = Ecm::open(&format!("{link}?role=reader")).expect("a reader");
    reader.adopt(&Config::drives(2)).expect("two drives");
    let machine = Machine { board, web, reader };
    let mut hand = Hand::of(&machine);
    hand.send(&json!({"do": "take"}));
    hand.wait_for_holder("you");
    hand.order(&json!({"do": "op"}), "OP");
    hand.order(&json!({"do": "on", "slave": 1}), "X: on");
    hand.wait(|message| message["type"] == "ask");
    let start = machine.stands();
    hand.hold_until_it_moves(&machine, true);
    hand.hold = Value::Null;
    assert!(machine.stands() < start);
    machine.end();
}

/// Without `--control` the page moves nothing, whatever it sends. With it, the board must be a served one.
#[test]
fn control_is_given_by_an_option_for_a_served_board() {
    let board = Serving::start("tcp", &["--link", "sim:?slaves=drive*2,io", "--machine", "none"]);
    let web = Serving::start("web", &["--link", &board.link(), "--machine", "none"]);
    let mut socket = web.socket().expect("a place");
    assert_eq!(next_text(&mut socket, &mut Vec::new())["control"], false);
    socket.send(Message::text(r#"{"do":"take"}"#)).expect("it reads");
    for _ in 0..10 {
        let message = next_text(&mut socket, &mut Vec::new());
        assert!(["channels", "events", "status"].contains(&message["type"].as_str().expect("a type")), "{message}");
    }
    web.end();
    board.end();
    run(["serve", "web", "--control", "--link", "sim:?slaves=drive", "--machine", "none"]).expect_failure(
        2,
        &["--control needs a board that `ecmsk serve tcp` has"],
        "ecmsk serve web --link tcp://localhost --control",
    );
}
