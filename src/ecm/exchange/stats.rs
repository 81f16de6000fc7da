//! What is counted since the board was opened, and what is worth a line in a program's log.

use std::collections::VecDeque;

use crate::sk::StateByte;

/// News kept until somebody takes them; the oldest go first. \[OURS]
const NEWS_KEPT: usize = 64;

/// Something that a program may want to log, and that fails no call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// Byte 1 of slot 0 changed: the count of CRC errors of firmware 1.7 (SK-2.7).
    ErrorByte {
        /// Before.
        from: u8,
        /// Now.
        to: u8,
    },
    /// The FIFO-full count went up: commands were lost. The numbers are the board's own (SK-5.10).
    CommandsLost {
        /// Before.
        from: u16,
        /// Now.
        to: u16,
    },
    /// Reports that nobody read, or that were lost on the way.
    ReportsLost {
        /// How many.
        count: u64,
    },
    /// A report was discarded, because its CRC is wrong.
    BadCrc,
    /// The state shows a failure, as when slaves are lost in OP (SK-4.61). The other slaves go on, the slots of the lost ones
    /// keep old values, and the wire does not say which they are. [`Ecm::set_state`](super::super::Ecm::set_state) brings
    /// back those that are connected again.
    SlavesFailed {
        /// What it shows.
        state: StateByte,
    },
}

/// Counts since the board was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Command frames written.
    pub written: u64,
    /// Reports that could be used.
    pub reports: u64,
    /// Reports discarded for a wrong CRC.
    pub bad_crc: u64,
    /// Reports lost before they were read.
    pub reports_lost: u64,
    /// Reports discarded because they came twice or too late.
    pub stale: u64,
    /// Times byte 1 of slot 0 was seen changed.
    pub error_byte_changes: u64,
    /// Times the FIFO-full count was seen increased. How many commands were lost each time the wire does not say for sure,
    /// and no division finds out (SK-5.10).
    pub losses: u64,
    /// Cycles of streams that found the FIFO empty.
    pub underruns: u64,
    /// Times the state began to show a failure (0x10).
    pub slaves_failed: u64,
}

impl Stats {
    /// Reports that were read, whether they could be used or not.
    pub(super) const fn reads(&self) -> u64 {
        self.reports + self.bad_crc + self.stale
    }
}

/// News that nobody has taken yet.
pub struct NewsQueue(VecDeque<News>);

impl NewsQueue {
    /// With room for all that are kept: reading a report must not allocate.
    pub fn new() -> Self {
        Self(VecDeque::with_capacity(NEWS_KEPT))
    }

    pub fn push(&mut self, news: News) {
        if self.0.len() == NEWS_KEPT {
            self.0.pop_front();
        }
        self.0.push_back(news);
    }

    pub fn take(&mut self) -> Vec<News> {
        self.0.drain(..).collect()
    }
}
