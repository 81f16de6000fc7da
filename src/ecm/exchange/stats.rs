//! Counters of frames, reports and failures since the board was opened, and events for the log of a program.

use std::collections::VecDeque;

use crate::sk::StateByte;

/// The maximum number of events that wait for the program; the oldest are dropped first. \[OURS]
const NEWS_KEPT: usize = 64;

/// An event that a program may want to log, and that makes no call fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// Byte 1 of slot 0 has changed in the reports. In firmware 1.7 the byte counts command frames with a wrong CRC (SK-2.7).
    ErrorByte {
        /// The previous value of the byte.
        from: u8,
        /// The present value of the byte.
        to: u8,
    },
    /// The board's FIFO-full count has risen, so commands were lost (SK-5.10).
    CommandsLost {
        /// The previous FIFO-full count.
        from: u16,
        /// The present FIFO-full count.
        to: u16,
    },
    /// Reports were lost on the way, or the program did not read them in time.
    ReportsLost {
        /// The number of lost reports.
        count: u64,
    },
    /// A report with a wrong CRC was discarded.
    BadCrc,
    /// The state byte shows a failure, for example because slaves are lost in OP (SK-4.61). The other slaves go on. The
    /// slots of lost slaves keep old values, and the state byte does not say which slaves these are.
    /// [`Ecm::set_state`](super::super::Ecm::set_state) brings slaves back that are connected again.
    SlavesFailed {
        /// The state byte.
        state: StateByte,
    },
}

/// Counters of frames, reports and failures since the board was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Command frames that were written.
    pub written: u64,
    /// Reports that were read and used: their CRC was right, and no newer report had been read before.
    pub reports: u64,
    /// Reports that were discarded because of a wrong CRC.
    pub bad_crc: u64,
    /// Reports that were lost before they were read, counted by the gaps in the sequence numbers.
    pub reports_lost: u64,
    /// Reports that were discarded because their sequence number was not higher than that of the newest report.
    pub stale: u64,
    /// How often byte 1 of slot 0 has changed, which in firmware 1.7 counts command frames with a wrong CRC.
    pub error_byte_changes: u64,
    /// How often the FIFO-full count has risen. The count does not show how many commands were lost each time (SK-5.10).
    pub losses: u64,
    /// Cycles that found the FIFO empty while a stream was open.
    pub underruns: u64,
    /// How often the state byte in reports began to show a failure ([`StateByte::is_failed`]).
    pub slaves_failed: u64,
}

impl Stats {
    /// The number of reports that were read, usable or not.
    pub(super) const fn reads(&self) -> u64 {
        self.reports + self.bad_crc + self.stale
    }
}

/// The events that the program has not taken yet.
pub struct NewsQueue(VecDeque<News>);

impl NewsQueue {
    /// Allocates room for `NEWS_KEPT` events in advance, because reading a report must not allocate.
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
