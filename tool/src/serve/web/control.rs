//! What the pages of `ecmsk serve web --control` may do besides showing: one of them has control of the board, and any
//! of them can stop it.
//!
//! The page that has control is asked every 50 ms which button is held. `desk.rs` has its answers and orders, for the thread
//! of `hand.rs`, which commands the board.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::link::tcp::stop;
use ecmsk::link::uri::LinkUri;
use serde::Deserialize;
use serde_json::json;

use super::client::Hears;
use super::desk::{Desk, End, Order, Press};
use super::hand;
use crate::board;
use crate::lock::lock;
use crate::stop::stopped_text;

/// The interval of the questions to the page that has control. \[OURS]
const ASK_INTERVAL: Duration = Duration::from_millis(50);
/// The largest number of questions without an answer that are remembered: those of twice [`SILENT_MAX`](super::desk::SILENT_MAX). \[OURS]
const QUESTIONS_MAX: usize = 40;
/// A page that asks for control while another one has it gets it within this time, or not at all. \[OURS]
const WANTED_MAX: Duration = Duration::from_secs(30);
/// The longest wait for the hand and for running stops when the server ends. \[OURS]
const END_MAX: Duration = Duration::from_secs(5);
/// The largest number of stops that are under way at the same time; one more press is carried out after the last of them.
/// The server of a board takes four. \[OURS]
const STOPS_MAX: u32 = 3;
/// The number of texts that are kept for pages. \[OURS]
const TEXTS_MAX: usize = 50;

/// A message of a page.
#[derive(Debug, Deserialize, PartialEq)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
enum Message {
    /// Asks for control.
    Take,
    /// Gives control up.
    Give,
    /// Answers the question `n`: what is held.
    Alive { n: u32, hold: Option<Press> },
    /// Nothing is held any more.
    Release,
    /// Ends what this page has begun: jogging, homing and orders that wait.
    Halt,
    /// Stops all axes, whoever moves them.
    Stop,
    /// An order for the board.
    #[serde(untagged)]
    Order(Order),
}

/// The control of a board that is shared by all pages.
pub struct Controls {
    /// The options with which the hand opens the board.
    args: board::Args,
    uri: LinkUri,
    state: Mutex<State>,
    /// Counts the changes of the state, so that connections see that there is something to send.
    version: AtomicU64,
}

#[derive(Default)]
struct State {
    pages: u32,
    session: Option<Session>,
    /// The page that asks for control while another one has it, and since when.
    wanted_by: Option<(u32, Instant)>,
    /// The newest texts for the pages.
    texts: VecDeque<Text>,
    /// The number of texts so far.
    text_count: u64,
    /// The number of stops that are under way, and whether another one is to follow the last of them.
    stops: u32,
    is_stop_again: bool,
    /// Whether the server ends, so that nobody gets control.
    ends: bool,
}

/// A text for all pages.
struct Text {
    text: String,
    is_error: bool,
    /// Whether it says what has become of a stop.
    is_stop: bool,
}

struct Session {
    page: u32,
    desk: Arc<Desk>,
    /// Whether the board is open, so that the page has control.
    is_open: bool,
    /// What the hand does at present.
    busy: Option<String>,
}

impl Controls {
    /// The control of the served board `uri`. `args` are the options with which it is opened for the page that has
    /// control.
    pub fn new(uri: LinkUri, args: board::Args) -> Arc<Self> {
        Arc::new(Self { args, uri, state: Mutex::default(), version: AtomicU64::new(1) })
    }

    /// Adds a page.
    pub fn join(self: &Arc<Self>) -> PageControl {
        let mut state = lock(&self.state);
        state.pages += 1;
        PageControl {
            page: state.pages,
            controls: Arc::clone(self),
            asked: VecDeque::new(),
            questions: 0,
            next_question: Instant::now(),
            seen: 0,
            seen_texts: state.text_count,
        }
    }

    /// Ends control for good, and waits until the board is closed and a stop that is under way is done, at most for
    /// [`END_MAX`].
    pub fn end(&self) {
        let until = Instant::now() + END_MAX;
        lock(&self.state).ends = true;
        while Instant::now() < until {
            {
                let state = lock(&self.state);
                if state.session.is_none() && state.stops == 0 {
                    return;
                }
                state.session.iter().for_each(|session| session.desk.end(End::Server));
            }
            thread::sleep(Duration::from_millis(5));
        }
    }

    fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let changed = change(&mut lock(&self.state));
        self.version.fetch_add(1, Ordering::Release);
        changed
    }

    /// Shows a text on all pages.
    pub fn say(&self, text: &str, is_error: bool) {
        self.add(Text { text: text.to_owned(), is_error, is_stop: false });
    }

    fn add(&self, text: Text) {
        self.change(|state| {
            state.texts.push_back(text);
            state.text_count += 1;
            if state.texts.len() > TEXTS_MAX {
                state.texts.pop_front();
            }
        });
    }

    /// Shows on all pages what the hand does at present; the page has control from the first call on.
    pub fn set_busy(&self, busy: Option<&str>) {
        self.change(|state| {
            if let Some(session) = &mut state.session {
                (session.is_open, session.busy) = (true, busy.map(str::to_owned));
            }
        });
    }

    fn take(self: &Arc<Self>, page: u32) {
        if lock(&self.state).stops > 0 {
            return self.say("a stop is under way; take control after it", true);
        }
        let desk = self.change(|state| match &state.session {
            Some(session) => {
                let now = Instant::now();
                if session.page != page || session.desk.why_ended(now).is_some() {
                    state.wanted_by = Some((page, now));
                }
                None
            }
            None if state.ends => None,
            None => {
                let desk = Arc::new(Desk::new(Instant::now()));
                state.session = Some(Session { page, desk: Arc::clone(&desk), is_open: false, busy: None });
                Some(desk)
            }
        });
        let Some(desk) = desk else { return };
        let controls = Arc::clone(self);
        let spawned = thread::Builder::new().name("hand".into()).spawn(move || {
            // Control ends also if this thread panics.
            let session = Ended(controls);
            hand::run(&session.0, &desk, &session.0.args);
        });
        if let Err(error) = spawned {
            self.say(&format!("cannot start a thread: {error}; end other programs, then take control again"), true);
            self.ended();
        }
    }

    /// The board is closed: the page that has asked for control gets it.
    fn ended(self: &Arc<Self>) {
        let next = self.change(|state| {
            state.session = None;
            state.wanted_by.take().filter(|(_, since)| since.elapsed() < WANTED_MAX)
        });
        if let Some((page, _)) = next {
            self.take(page);
        }
    }

    /// Ends the control of any page, and stops all axes in a thread of its own, whoever moves them.
    fn stop(self: &Arc<Self>) {
        let begins = self.change(|state| {
            // First what this process moves itself: that needs no connection. A board that is being opened for a page
            // moves nothing after the stop, either, and a page that waits does not get it.
            state.session.iter().for_each(|session| session.desk.end(End::Stopped));
            state.wanted_by = None;
            let begins = state.stops < STOPS_MAX;
            state.stops += u32::from(begins);
            state.is_stop_again |= !begins;
            begins
        });
        if !begins {
            return;
        }
        let stopping = Stopping(Arc::clone(self));
        let spawned = thread::Builder::new().name("stop".into()).spawn(move || while stopping.0.stop_once() {});
        if let Err(error) = spawned {
            self.not_stopped(&format!("cannot start a thread: {error}"), true);
        }
    }

    /// Stops all axes by the server of the board; returns whether another stop is to follow.
    fn stop_once(&self) -> bool {
        let stopped = stop(&self.uri, false);
        let (is_last, is_again) = {
            let mut state = lock(&self.state);
            let is_last = state.stops == 1;
            (is_last, is_last && std::mem::take(&mut state.is_stop_again))
        };
        match stopped {
            Ok(stopped) => {
                let text = stopped_text(&stopped, false, true);
                self.add(Text { text, is_error: false, is_stop: !is_again });
            }
            Err(error) => self.not_stopped(&error.to_string(), is_last && !is_again),
        }
        is_again
    }

    fn not_stopped(&self, why: &str, is_stop: bool) {
        let next = if why.contains("emergency stop") { "" } else { "; use the emergency stop if axes move" };
        self.add(Text { text: format!("NOT STOPPED: {why}{next}"), is_error: true, is_stop });
    }
}

/// A stop that is under way, also if its thread panics.
struct Stopping(Arc<Controls>);

impl Drop for Stopping {
    fn drop(&mut self) {
        self.0.change(|state| state.stops -= 1);
        if thread::panicking() {
            self.0.not_stopped("a thread of this server has panicked", true);
        }
    }
}

/// Ends the session when it is dropped.
struct Ended(Arc<Controls>);

impl Drop for Ended {
    fn drop(&mut self) {
        self.0.ended();
    }
}

/// The control as one page has it. Dropping it ends what the page has begun.
pub struct PageControl {
    controls: Arc<Controls>,
    page: u32,
    /// The questions without an answer: their numbers, and when they were sent.
    asked: VecDeque<(u32, Instant)>,
    questions: u32,
    next_question: Instant,
    /// The version of the state, and the number of texts, that the page has.
    seen: u64,
    seen_texts: u64,
}

impl PageControl {
    /// The desk of the session, if this page has it.
    fn desk(&self) -> Option<Arc<Desk>> {
        let state = lock(&self.controls.state);
        state.session.as_ref().filter(|session| session.page == self.page).map(|session| Arc::clone(&session.desk))
    }
}

impl Hears for PageControl {
    fn message(&mut self, text: &str) {
        let message = match serde_json::from_str(text) {
            Ok(message) => message,
            Err(error) => {
                return self.controls.say(&format!("a page sends what this server does not know: {error}"), true);
            }
        };
        match message {
            Message::Take => self.controls.take(self.page),
            Message::Stop => self.controls.stop(),
            Message::Give => self.desk().iter().for_each(|desk| desk.end(End::Given)),
            Message::Halt => self.desk().iter().for_each(|desk| desk.halt()),
            Message::Release => self.desk().iter().for_each(|desk| desk.release()),
            Message::Alive { n, hold } => {
                let Some(at) = self.asked.iter().position(|(question, _)| *question == n) else { return };
                let asked = self.asked[at].1;
                self.asked.drain(..=at);
                let hold = hold.filter(|press| press.part > 0.0 && press.part <= 1.0);
                if self.desk().is_some_and(|desk| !desk.alive(asked, hold)) {
                    self.controls
                        .say("the button does not count: something else runs; press it again after that", true);
                }
            }
            Message::Order(order) => match self.desk() {
                None => self.controls.say("take control first", true),
                Some(_) if !order.is_words() => {
                    let text =
                        "an object, a type or a value is one word: 0x6041, 0x1018:4, homing_method, 1000, -5, 0x3E8";
                    self.controls.say(text, true);
                }
                Some(desk) if desk.order(order.clone()) => {}
                Some(_) => {
                    let text =
                        format!("`{}` is not done: something else runs; wait for its end, or press Off", order.line());
                    self.controls.say(&text, true);
                }
            },
        }
    }

    fn due(&mut self, now: Instant) -> Vec<String> {
        let mut messages = Vec::new();
        if now >= self.next_question && self.desk().is_some() {
            self.next_question = now + ASK_INTERVAL;
            let is_old = |since: Instant| now.saturating_duration_since(since) >= WANTED_MAX;
            if lock(&self.controls.state).wanted_by.is_some_and(|(_, since)| is_old(since)) {
                self.controls.change(|state| state.wanted_by = None);
            }
            self.questions = self.questions.wrapping_add(1);
            self.asked.push_back((self.questions, now));
            if self.asked.len() > QUESTIONS_MAX {
                self.asked.pop_front();
            }
            messages.push(json!({"type": "ask", "n": self.questions}).to_string());
        }
        let version = self.controls.version.load(Ordering::Acquire);
        if version == self.seen {
            return messages;
        }
        self.seen = version;
        let state = lock(&self.controls.state);
        let new = usize::try_from(state.text_count - self.seen_texts).unwrap_or(usize::MAX).min(state.texts.len());
        for Text { text, is_error, is_stop } in state.texts.range(state.texts.len() - new..) {
            messages.push(json!({"type": "said", "text": text, "is_error": is_error, "is_stop": is_stop}).to_string());
        }
        self.seen_texts = state.text_count;
        let session = state.session.as_ref();
        let holder = match session {
            None => "none",
            Some(session) if session.page != self.page => "other",
            Some(session) if session.is_open => "you",
            Some(_) => "opening",
        };
        let busy = session.and_then(|session| session.busy.as_deref());
        let message =
            json!({"type": "control", "holder": holder, "is_wanted": state.wanted_by.is_some(), "busy": busy});
        messages.push(message.to_string());
        messages
    }
}

impl Drop for PageControl {
    fn drop(&mut self) {
        self.controls.change(|state| {
            state.wanted_by = state.wanted_by.filter(|(page, _)| *page != self.page);
        });
        self.desk().iter().for_each(|desk| desk.end(End::Gone));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLUS: Press = Press { press: 1, slave: 1, is_positive: true, part: 1.0 };

    /// The messages of a page; what is not one of them is refused.
    #[test]
    fn messages_are_read_strictly() {
        let read = |text: &str| serde_json::from_str::<Message>(text).ok();
        assert_eq!(read(r#"{"do":"stop"}"#), Some(Message::Stop));
        let alive = r#"{"do":"alive","n":7,"hold":{"press":1,"slave":1,"is_positive":true,"part":1}}"#;
        assert_eq!(read(alive), Some(Message::Alive { n: 7, hold: Some(PLUS) }));
        assert_eq!(read(r#"{"do":"home","slave":3}"#), Some(Message::Order(Order::Home { slave: 3 })));
        for wrong in [
            "",
            "{}",
            r#"{"do":"run"}"#,
            r#"{"do":"home"}"#,
            r#"{"do":"home","slave":256}"#,
            r#"{"do":"home","slave":1,"method":35}"#,
            r#"{"do":"alive","n":7,"hold":{"press":1,"slave":1,"is_positive":true}}"#,
            r#"{"do":"alive","n":7,"hold":{"press":1,"slave":1,"is_positive":true,"part":null}}"#,
        ] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }
}
