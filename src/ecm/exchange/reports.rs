//! The newest report and the one before it, and the rules by which a report is discarded.

use std::time::Duration;

use super::stats::{News, NewsQueue, Stats};
use crate::link::{ReadMeta, Stamp};
use crate::sk::{CrcPolicy, Frame, MasterResponse, MasterState, SlotSize};

/// The newest reports of a board: the one that is being read, the newest accepted one, and the one before it.
pub struct Reports {
    size: SlotSize,
    crc_policy: CrcPolicy,
    /// The buffer into which the link reads the next report.
    pub incoming: Box<Frame>,
    pub newest: Box<Frame>,
    pub previous: Box<Frame>,
    /// The time and the sequence number of the newest report; `None` before the first one.
    pub meta: Option<ReadMeta>,
    /// The time and the sequence number of the report before the newest.
    previous_meta: Option<ReadMeta>,
    /// The highest sequence number of a report so far, also of one with a wrong CRC.
    last_sequence: u64,
    /// Slot 0 of the newest report.
    pub board: MasterResponse,
    /// When the last usable report was read, on the clock of timeouts.
    pub heard_at: Duration,
    /// When the last usable report was read, on the link's clock. In virtual time: when it was made.
    pub read_at: Duration,
}

impl Reports {
    pub fn new(size: SlotSize, crc_policy: CrcPolicy) -> Self {
        Self {
            size,
            crc_policy,
            incoming: Box::default(),
            newest: Box::default(),
            previous: Box::default(),
            meta: None,
            previous_meta: None,
            last_sequence: 0,
            board: MasterResponse::default(),
            heard_at: Duration::ZERO,
            read_at: Duration::ZERO,
        }
    }

    /// Accepts the report in `incoming`, unless its CRC is wrong or a newer report was accepted before. Returns whether
    /// it was accepted.
    pub fn accept(&mut self, meta: ReadMeta, stats: &mut Stats, news: &mut NewsQueue) -> bool {
        if self.incoming.check_crc(self.size, self.crc_policy).is_err() {
            stats.bad_crc += 1;
            news.push(News::BadCrc);
            self.last_sequence = self.last_sequence.max(meta.sequence);
            return false;
        }
        if let Some(newest) = self.meta {
            if meta.sequence <= newest.sequence {
                stats.stale += 1;
                return false;
            }
            let lost = meta.sequence.saturating_sub(self.last_sequence + 1);
            if lost > 0 {
                stats.reports_lost += lost;
                news.push(News::ReportsLost { count: lost });
            }
        }
        self.last_sequence = self.last_sequence.max(meta.sequence);
        std::mem::swap(&mut self.newest, &mut self.previous);
        std::mem::swap(&mut self.incoming, &mut self.newest);
        self.previous_meta = self.meta.replace(meta);
        stats.reports += 1;
        true
    }

    /// Decodes slot 0 of the newest report. Counts a change of the error byte, and a change of the state byte to a
    /// failure. Returns slot 0 of the previous report.
    pub fn read_board(&mut self, stats: &mut Stats, news: &mut NewsQueue) -> MasterResponse {
        let before = std::mem::replace(&mut self.board, MasterResponse::decode(&self.newest.slot(self.size, 0)));
        if self.previous_meta.is_none() {
            return before;
        }
        if before.error != self.board.error {
            stats.error_byte_changes += 1;
            news.push(News::ErrorByte { from: before.error, to: self.board.error });
        }
        if self.board.state.is_failed() && !before.state.is_failed() {
            stats.slaves_failed += 1;
            news.push(News::SlavesFailed { state: self.board.state });
        }
        before
    }

    /// The number of cycles from the previous report to the newest one, and the length of a cycle in nanoseconds;
    /// `None` without a previous report.
    pub fn cycles(&self) -> Option<(u64, u64)> {
        let (newest, previous) = (self.meta?, self.previous_meta?);
        let cycles = newest.sequence - previous.sequence;
        Some((cycles, newest.at.0.saturating_sub(previous.at.0) / cycles.max(1)))
    }

    pub fn in_op(&self) -> bool {
        self.board.state.state() == Some(MasterState::Op)
    }

    /// When the newest report was made, on the link's clock; 0 before the first one.
    pub fn at(&self) -> Stamp {
        self.meta.map_or(Stamp(0), |meta| meta.at)
    }

    /// When the previous report was made; if there is none, when the newest was made.
    pub fn previous_at(&self) -> Stamp {
        self.previous_meta.or(self.meta).map_or(Stamp(0), |meta| meta.at)
    }
}
