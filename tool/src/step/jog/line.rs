//! Measures the delay of the line to a terminal. A status query is sent to the terminal at regular intervals. The
//! terminal puts its answer after the keys that were pressed before. So a key that arrives after an answer was pressed
//! after the query was sent.

use std::collections::VecDeque;
use std::time::Duration;

/// \[OURS] The interval between two status queries.
pub const ASK_INTERVAL: Duration = Duration::from_millis(50);
/// \[OURS] Keys count only if the latest answered query was sent at most this long ago. So an axis stops at most this
/// much later than the key is released.
const LATE: Duration = Duration::from_millis(200);
/// \[OURS] With this many unanswered queries, no further query is sent.
const UNANSWERED_MAX: usize = 40;

/// The status queries to a terminal, and its answers.
#[derive(Debug, Default)]
pub struct Line {
    /// The send times of the unanswered queries, the oldest first.
    unanswered: VecDeque<Duration>,
    /// The send time of the latest answered query.
    answered: Option<Duration>,
}

impl Line {
    /// Records that a query is sent. Returns false if it must not be sent, because [`UNANSWERED_MAX`] queries are
    /// unanswered.
    pub fn ask(&mut self, at: Duration) -> bool {
        let may = self.unanswered.len() < UNANSWERED_MAX;
        if may {
            self.unanswered.push_back(at);
        }
        may
    }

    /// Records that the terminal has answered its oldest unanswered query.
    pub fn answer(&mut self) {
        self.answered = self.unanswered.pop_front().or(self.answered);
    }

    /// Whether keys that arrive at the time `now` may be too old.
    pub fn is_late(&self, now: Duration) -> bool {
        self.answered.is_none_or(|asked| now > asked + LATE)
    }
}
