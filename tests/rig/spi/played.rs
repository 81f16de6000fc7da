//! A board on the wires: a thread that answers exchanges and drives BUSY, with the model or a test behind it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::wires::{Event, Exchange, Reset, Wires};

/// The interval at which it checks whether it shall end.
const LOOK: Duration = Duration::from_millis(5);

/// The board's reactions.
pub trait Board: Send {
    /// `mosi` was received; `miso` is sent.
    fn exchange(&mut self, mosi: &[u8], miso: &mut [u8]);

    /// Processes `mosi` after the exchange; BUSY is high until it returns.
    fn process(&mut self) {}

    /// RESET has been low for that long and is high again. Returns whether the board boots.
    fn reset(&mut self, low: Duration) -> bool {
        let _ = low;
        false
    }

    /// Whether it is still booting.
    fn is_busy(&mut self) -> bool {
        false
    }

    /// The level of its line while it is busy, or is not.
    fn level(&mut self, busy: bool) -> bool {
        busy
    }
}

impl<T: FnMut(&[u8], &mut [u8]) + Send> Board for T {
    fn exchange(&mut self, mosi: &[u8], miso: &mut [u8]) {
        self(mosi, miso);
    }
}

/// The level of the line BUSY.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Busy {
    /// Correct: high from the start of an exchange until the frame has been processed, and at start-up.
    True,
    Stuck(bool),
}

/// The host's exchanges and resets.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    pub exchanges: Vec<Exchange>,
    pub resets: Vec<Reset>,
    /// Exchanges that began while BUSY was high.
    pub while_busy: usize,
}

/// A board until it is dropped.
pub struct Played {
    stop: Arc<AtomicBool>,
    seen: Arc<Mutex<Seen>>,
    thread: Option<JoinHandle<()>>,
}

impl Played {
    /// Puts the board on the wires.
    #[track_caller]
    pub fn start(board: impl Board + 'static, busy: Busy) -> Self {
        let mut wires = Wires::open();
        let stop = Arc::new(AtomicBool::new(false));
        let seen = Arc::new(Mutex::new(Seen::default()));
        let shown = busy == Busy::Stuck(true);
        wires.set_busy(shown);
        let player = Player { wires, board, busy, shown, busy_now: false, low_since: None, seen: seen.clone() };
        let thread = thread::spawn({
            let stop = stop.clone();
            move || player.run(&stop)
        });
        Self { stop, seen, thread: Some(thread) }
    }

    /// The host's exchanges and resets so far.
    pub fn seen(&self) -> Seen {
        self.seen.lock().expect("nobody panics with it").clone()
    }

    /// Ends it and returns the host's exchanges and resets.
    #[track_caller]
    pub fn stop(mut self) -> Seen {
        self.end().expect("the board has played to its end");
        self.seen()
    }

    fn end(&mut self) -> thread::Result<()> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().map_or(Ok(()), JoinHandle::join)
    }
}

impl Drop for Played {
    fn drop(&mut self) {
        // A panicking test has already reported its reason.
        let _ = self.end();
    }
}

struct Player<B> {
    wires: Wires,
    board: B,
    busy: Busy,
    /// The line's level.
    shown: bool,
    busy_now: bool,
    low_since: Option<u64>,
    seen: Arc<Mutex<Seen>>,
}

impl<B: Board> Player<B> {
    fn run(mut self, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            let booting = self.board.is_busy();
            self.show_busy(booting);
            match self.wires.next(LOOK).expect("the module is there") {
                Some(Event::Exchange(exchange, mosi)) => self.exchange(exchange, &mosi),
                Some(Event::Reset(reset)) => self.reset(reset),
                None => {}
            }
        }
    }

    fn exchange(&mut self, exchange: Exchange, mosi: &[u8]) {
        {
            let mut seen = self.seen.lock().expect("nobody panics with it");
            seen.exchanges.push(exchange);
            seen.while_busy += usize::from(self.busy_now);
        }
        self.show_busy(true);
        let mut miso = vec![0; mosi.len()];
        self.board.exchange(mosi, &mut miso);
        // A killed host does not wait for an answer.
        let _ = self.wires.answer(&miso);
        self.board.process();
        // BUSY falls with the next poll of the board.
    }

    fn reset(&mut self, reset: Reset) {
        self.seen.lock().expect("nobody panics with it").resets.push(reset);
        if !reset.high {
            self.low_since = Some(reset.at_ns);
        } else if let Some(since) = self.low_since.take()
            && self.board.reset(Duration::from_nanos(reset.at_ns - since))
        {
            self.show_busy(true);
        }
    }

    fn show_busy(&mut self, busy: bool) {
        self.busy_now = busy && self.busy == Busy::True;
        let level = self.board.level(busy);
        if self.busy == Busy::True && self.shown != level {
            self.wires.set_busy(level);
            self.shown = level;
        }
    }
}
