//! The keys of a terminal as a hold-to-run control.

use std::io;
use std::thread;
use std::time::{Duration, Instant};

use ratatui::crossterm::event::KeyCode;

use super::dead_man::{DeadMan, Times};
use super::line::ASK_INTERVAL;
use super::terminal::{self, HAS_ANSWERS, Terminal, Token};
use super::{Held, HoldToRun, JogMotion, refused};
use crate::board::{Board, BoardError};
use crate::signals;

/// \[OURS] The interval between two checks whether the terminal was closed.
const CLOSED_CHECK_INTERVAL: Duration = Duration::from_millis(20);
/// \[OURS] The longest wait for the first answer of a terminal.
const ANSWER_LIMIT: Duration = Duration::from_secs(1);
/// The keys of each axis, in the order in which the axes are named: the key for back, the key for forth, and the names
/// of both. If there is only one axis, all keys move it.
pub const KEYS: [(KeyCode, KeyCode, &str); 3] = [
    (KeyCode::Left, KeyCode::Right, "left and right"),
    (KeyCode::Down, KeyCode::Up, "down and up"),
    (KeyCode::Char('-'), KeyCode::Char('+'), "- and +"),
];

/// The keys of a terminal.
pub struct Keyboard {
    terminal: Terminal,
    keys: DeadMan,
    began: Instant,
    /// The number of axes.
    axes: usize,
    next_closed_check: Instant,
    next_question: Instant,
}

impl Keyboard {
    /// Begins to read the keys for that many axes. Unless `any_line`, keys count only if the delay of the line to the
    /// terminal is known and short.
    ///
    /// # Errors
    /// The terminal cannot be read, was closed, or does not answer; a signal has arrived.
    pub fn open(board: &Board, axes: usize, times: Times, any_line: bool) -> Result<Self, BoardError> {
        let terminal = Terminal::open().map_err(BoardError::system("read the keys of the terminal"))?;
        let is_measured = HAS_ANSWERS && !any_line;
        if is_measured {
            require_answer(board, &terminal)?;
        }
        let began = Instant::now();
        let keys = DeadMan::new(times, is_measured);
        Ok(Self { terminal, keys, began, axes, next_closed_check: began, next_question: began })
    }

    fn at(&self, at: Instant) -> Duration {
        at.saturating_duration_since(self.began)
    }

    /// Processes the keys that have arrived; returns whether one of them ends jogging.
    fn take_keys(&mut self) -> Result<bool, BoardError> {
        while let Some((at, token)) = self.terminal.next().map_err(|_| closed())? {
            let at = self.at(at);
            let (code, is_release) = match token {
                Token::Key { code, is_release } => (code, is_release),
                Token::Interrupt => (KeyCode::Null, false),
                Token::Answer => {
                    self.keys.answer();
                    continue;
                }
            };
            match self.motion(code) {
                Some(motion) if !is_release => self.keys.press(at, motion),
                // The release of a key that moves no axis is ignored; its press has already stopped the axes.
                None if is_release => {}
                None if matches!(code, KeyCode::Char('q' | 'Q') | KeyCode::Esc) => return Ok(true),
                _ => self.keys.stop(at),
            }
        }
        Ok(false)
    }

    /// The motion that a key requests; `None` if it moves no axis.
    fn motion(&self, code: KeyCode) -> Option<JogMotion> {
        // On many keyboards, `=` is the key of `+` without Shift.
        let code = if code == KeyCode::Char('=') { KeyCode::Char('+') } else { code };
        let found = KEYS.iter().enumerate().find_map(|(axis, (back, forth, _))| {
            (code == *back || code == *forth).then_some(JogMotion { axis, is_positive: code == *forth })
        })?;
        match self.axes {
            1 => Some(JogMotion { axis: 0, ..found }),
            count => (found.axis < count).then_some(found),
        }
    }
}

impl HoldToRun for Keyboard {
    fn held(&mut self) -> Result<Held, BoardError> {
        let now = Instant::now();
        if now >= self.next_closed_check {
            self.next_closed_check = now + CLOSED_CHECK_INTERVAL;
            if signals::has_hung_up(&io::stdin()) {
                return Err(closed());
            }
        }
        if now >= self.next_question {
            self.next_question = now + ASK_INTERVAL;
            if self.keys.ask(self.at(now)) {
                self.terminal.ask();
            }
        }
        if self.take_keys()? {
            return Ok(Held::End);
        }
        Ok(self.keys.held(self.at(Instant::now())).map_or(Held::Nothing, Held::Runs))
    }

    /// Keys that were typed before now do not count.
    fn stalled(&mut self) {
        self.keys.stalled(self.at(Instant::now()));
    }

    fn trouble(&self) -> Option<String> {
        let is_late = self.keys.is_line_late(self.at(Instant::now()));
        is_late.then(|| "keys come late and do not count".to_owned())
    }

    fn width(&self) -> usize {
        terminal::width().saturating_sub(1)
    }
}

/// Waits for an answer of the terminal. Without an answer, the delay of the line is unknown, so no key may move an
/// axis.
///
/// # Errors
/// The terminal does not answer, or was closed; a signal has arrived.
fn require_answer(board: &Board, terminal: &Terminal) -> Result<(), BoardError> {
    let began = Instant::now();
    terminal.ask();
    while began.elapsed() < ANSWER_LIMIT {
        board.check_stop()?;
        match terminal.next().map_err(|_| closed())? {
            Some((_, Token::Answer)) => return Ok(()),
            Some(_) => {}
            None => thread::sleep(Duration::from_millis(1)),
        }
    }
    let why = "the terminal does not answer (to ESC [5n), so that nobody knows how late its keys come".to_owned();
    Err(refused(why, "run it in another terminal, or add --any-line if no network is between it and you"))
}

fn closed() -> BoardError {
    BoardError::Stopped { signal: signals::HANG_UP as u8, next: "the terminal was closed".into() }
}
