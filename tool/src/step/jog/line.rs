//! How late the line to a terminal is. Questions are sent to the terminal all the time. It answers each behind the keys that
//! were pressed before. So a key that follows an answer was pressed after that question was asked.

use std::collections::VecDeque;
use std::time::Duration;

/// \[OURS] How often the terminal is asked.
pub const ASK_INTERVAL: Duration = Duration::from_millis(50);
/// \[OURS] Keys count if they follow the answer to a question that was asked this long ago at most: so much later than the
/// hand an axis may stop.
const LATE: Duration = Duration::from_millis(200);
/// \[OURS] Questions without an answer, from which on no further one is asked.
const UNANSWERED_MAX: usize = 40;

/// The questions to a terminal, and its answers.
#[derive(Debug, Default)]
pub struct Line {
    /// When those were asked that have no answer yet, the oldest first.
    unanswered: VecDeque<Duration>,
    /// When the newest one was asked that has an answer.
    answered: Option<Duration>,
}

impl Line {
    /// Notes that the terminal is asked. Returns false if it should not be: it does not answer.
    pub fn ask(&mut self, at: Duration) -> bool {
        let may = self.unanswered.len() < UNANSWERED_MAX;
        if may {
            self.unanswered.push_back(at);
        }
        may
    }

    /// The terminal has answered the oldest question.
    pub fn answer(&mut self) {
        self.answered = self.unanswered.pop_front().or(self.answered);
    }

    /// Whether keys that arrive now may be too old.
    pub fn is_late(&self, now: Duration) -> bool {
        self.answered.is_none_or(|asked| now > asked + LATE)
    }
}
