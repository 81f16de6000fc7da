//! The board's FIFO as the host can know it: what is free, what is ahead, when it ran dry.
//!
//! A report shows the free count of its moment; frames written since are not in it. So the credit is the newest free
//! count less the frames written since, whether reports are read at once or from a queue.

use std::collections::VecDeque;

use crate::link::Stamp;
use crate::sk::FIFO_ENTRIES;

#[derive(Debug)]
pub(super) struct Credit {
    /// When the frames were written that no report surely counts yet, oldest first; never more than the FIFO holds.
    sent: VecDeque<Stamp>,
    /// Of the newest report.
    free: u16,
    /// Frames written since OP was reached.
    total: i64,
    /// Cycles since OP was reached.
    cycles: i64,
    /// `None`: a dry FIFO is no underrun now.
    watch: Option<Watch>,
    underruns: u64,
}

/// Since when underruns count.
#[derive(Clone, Copy, Debug)]
enum Watch {
    /// From the first report after more frames than that have been executed.
    From(i64),
    /// Idle cycles before that.
    Since(i64),
}

impl Credit {
    pub(super) fn new() -> Self {
        Self {
            sent: VecDeque::with_capacity(FIFO_ENTRIES.into()),
            free: FIFO_ENTRIES,
            total: 0,
            cycles: 0,
            watch: None,
            underruns: 0,
        }
    }

    /// The FIFO was left: it is empty.
    pub(super) fn reset(&mut self) {
        self.sent.clear();
        (self.free, self.total, self.cycles, self.watch) = (FIFO_ENTRIES, 0, 0, None);
    }

    /// A frame was written. Its number counts from 1.
    pub(super) fn sent(&mut self, at: Stamp) -> i64 {
        if self.sent.len() == usize::from(FIFO_ENTRIES) {
            self.sent.pop_front();
        }
        self.sent.push_back(at);
        self.total += 1;
        self.total
    }

    /// A report in OP. A frame counts as arrived for sure `margin_ns` after it was written.
    pub(super) fn report(&mut self, at: Stamp, free: u16, cycles: u64, margin_ns: u64) {
        while self.sent.front().is_some_and(|sent| sent.0.saturating_add(margin_ns) <= at.0) {
            self.sent.pop_front();
        }
        let had_entries = self.used() > 0;
        self.free = free.min(FIFO_ENTRIES);
        self.cycles += cycles as i64;
        let later = self.sent.iter().rev().take_while(|sent| **sent >= at).count() as i64;
        let arrived = self.total - later;
        // One entry a cycle is taken out, unless there is none.
        let idle = self.cycles - (arrived - i64::from(self.used()));
        match self.watch {
            Some(Watch::From(frames)) if arrived - i64::from(self.used()) > frames => {
                self.watch = Some(Watch::Since(idle))
            }
            Some(Watch::Since(before)) => {
                // A frame may be counted as arrived a little early, so the count may fall: what was seen stays.
                let new = (idle - before).max(0);
                if new > 0 {
                    // With entries before and after a cycle it found one: a frame was counted as arrived too early.
                    if !(cycles == 1 && had_entries && self.used() > 0) {
                        self.underruns += new as u64;
                    }
                    self.watch = Some(Watch::Since(idle));
                }
            }
            _ => {}
        }
    }

    /// Whether a dry FIFO counts as an underrun, from the next frame on.
    pub(super) fn watch(&mut self, on: bool) {
        self.watch = on.then_some(Watch::From(self.total));
    }

    /// Cycles that found no entry while they were watched.
    pub(super) const fn underruns(&self) -> u64 {
        self.underruns
    }

    const fn used(&self) -> u16 {
        FIFO_ENTRIES - self.free
    }

    /// Frames the board can take without losing one.
    pub(super) fn credit(&self) -> u16 {
        self.free.saturating_sub(self.sent.len() as u16)
    }

    /// Entries that are not executed yet, at most.
    pub(super) fn ahead(&self) -> u16 {
        FIFO_ENTRIES - self.credit()
    }

    /// Whether the frame of that number has been executed for sure.
    pub(super) fn ran(&self, number: i64) -> bool {
        self.total - self.sent.len() as i64 - i64::from(self.used()) >= number
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// SK-5.11 The credit is the newest free count less the frames written since.
    #[test]
    fn frames_written_since_the_report_are_taken_off() {
        let mut credit = Credit::new();
        credit.report(Stamp(10 * MS), 150, 1, MS);
        (0..3).for_each(|n| {
            credit.sent(Stamp(10 * MS + n));
        });
        assert_eq!((credit.credit(), credit.ahead()), (147, 13));
        // A report that was made before they were written, read from a queue.
        credit.report(Stamp(9 * MS), 155, 0, MS);
        assert_eq!(credit.credit(), 152);
        credit.report(Stamp(12 * MS), 149, 2, MS);
        assert_eq!(credit.credit(), 149);
    }

    /// SK-5.11 Cycles without an entry are counted, each once, and not before the first frame.
    #[test]
    fn cycles_without_an_entry_count() {
        let mut credit = Credit::new();
        credit.watch(true);
        (1..5).for_each(|n| credit.report(Stamp(n * MS), 160, 1, MS));
        credit.sent(Stamp(4 * MS + 5));
        credit.report(Stamp(5 * MS), 160, 1, MS);
        assert_eq!(credit.underruns(), 0);
        // Two cycles without a frame, told in one report; then one more.
        credit.report(Stamp(7 * MS), 160, 2, MS);
        credit.report(Stamp(8 * MS), 160, 1, MS);
        assert_eq!(credit.underruns(), 3);
        credit.sent(Stamp(8 * MS + 5));
        credit.report(Stamp(9 * MS), 160, 1, MS);
        assert_eq!(credit.underruns(), 3);
        credit.watch(false);
        credit.report(Stamp(19 * MS), 160, 10, MS);
        assert_eq!(credit.underruns(), 3);
    }

    /// SK-5.11 A frame that arrives a cycle later than it was written makes no underrun while others are queued.
    #[test]
    fn a_late_arrival_is_no_underrun() {
        let mut credit = Credit::new();
        credit.watch(true);
        credit.sent(Stamp(5));
        credit.sent(Stamp(6));
        credit.report(Stamp(MS), 159, 1, MS);
        credit.sent(Stamp(2 * MS - 1));
        credit.report(Stamp(2 * MS), 160, 1, MS);
        credit.report(Stamp(3 * MS), 160, 1, MS);
        assert_eq!(credit.underruns(), 0);
    }
}
