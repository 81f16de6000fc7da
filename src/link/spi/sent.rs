//! Which of the newest entries of the board's FIFO are the host's: the link's own are none that a program knows of.

use crate::sk::FIFO_ENTRIES;

/// Entries that count as in the FIFO however low its level is: the frame of this exchange, and those that its answer may
/// be older than. \[OURS]
const NOT_IN_THE_ANSWER: u16 = 3;
const KEPT: usize = FIFO_ENTRIES as usize + NOT_IN_THE_ANSWER as usize;

/// The frames sent, newest last.
pub(super) struct Sent {
    host: [bool; KEPT],
    next: usize,
}

impl Default for Sent {
    fn default() -> Self {
        Self { host: [false; KEPT], next: 0 }
    }
}

impl Sent {
    pub fn push(&mut self, host: bool) {
        self.host[self.next] = host;
        self.next = (self.next + 1) % KEPT;
    }

    /// How many entries of the host there are at most, if the newest answer says that level.
    pub fn of_the_host(&self, level: u16) -> u16 {
        let newest = usize::from((level + 1).max(NOT_IN_THE_ANSWER)).min(KEPT);
        let age = |age| self.host[(self.next + KEPT - 1 - age) % KEPT];
        (0..newest).filter(|number| age(*number)).count() as u16
    }
}
