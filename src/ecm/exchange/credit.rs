//! The host's model of the board's FIFO: for how many frames it has room, how many frames are not executed yet, and in
//! how many cycles it was empty.
//!
//! A report gives the number of free entries at the time it was made. It does not include frames written later. So the
//! credit is the newest free count minus the frames written since, whether reports are read at once or from a queue.

use std::collections::VecDeque;

use crate::link::Stamp;
use crate::sk::FIFO_ENTRIES;

#[derive(Debug)]
pub struct Credit {
    /// Write times of the frames that may have arrived only after the newest report was made, so that its free count may
    /// not include them; oldest first, and at most as many as the FIFO has entries.
    uncounted: VecDeque<Stamp>,
    /// The number of free entries in the newest report.
    free: u16,
    /// The number of frames written since OP was reached.
    written: i64,
    /// The number of board cycles since OP was reached: one for each report, lost reports included.
    cycles: i64,
    /// Whether cycles with an empty FIFO count as underruns now; `None` while no stream is open.
    counting: Option<Counting>,
    underruns: u64,
}

/// When the counting of underruns begins.
#[derive(Clone, Copy, Debug)]
enum Counting {
    /// Counting begins when the board has executed more than this many frames: with the first frame of the stream.
    After(i64),
    /// Counting has begun. The value is the highest number so far of cycles that found the FIFO empty.
    Since(i64),
}

impl Credit {
    pub fn new() -> Self {
        Self {
            uncounted: VecDeque::with_capacity(FIFO_ENTRIES.into()),
            free: FIFO_ENTRIES,
            written: 0,
            cycles: 0,
            counting: None,
            underruns: 0,
        }
    }

    /// Forgets all written frames, because the network has left OP, which empties the FIFO.
    pub fn reset(&mut self) {
        self.uncounted.clear();
        (self.free, self.written, self.cycles, self.counting) = (FIFO_ENTRIES, 0, 0, None);
    }

    /// Counts a written frame and returns its number, counted from 1 since OP was reached.
    pub fn wrote(&mut self, at: Stamp) -> i64 {
        if self.uncounted.len() == usize::from(FIFO_ENTRIES) {
            self.uncounted.pop_front();
        }
        self.uncounted.push_back(at);
        self.written += 1;
        self.written
    }

    /// Updates the model from a report in OP, made `cycles` cycles after the previous one. A frame that was written less
    /// than `margin_ns` before the report may have arrived too late to be in its free count.
    pub fn report(&mut self, at: Stamp, free: u16, cycles: u64, margin_ns: u64) {
        while self.uncounted.front().is_some_and(|sent| sent.0.saturating_add(margin_ns) <= at.0) {
            self.uncounted.pop_front();
        }
        let had_entries = self.used() > 0;
        self.free = free.min(FIFO_ENTRIES);
        self.cycles += cycles as i64;
        let later = self.uncounted.iter().rev().take_while(|sent| **sent >= at).count() as i64;
        let arrived = self.written - later;
        // The board executes one entry in each cycle, unless the FIFO is empty. So the cycles without an entry are all
        // cycles minus the executed entries, which are the arrived frames minus those still in the FIFO.
        let idle = self.cycles - (arrived - i64::from(self.used()));
        match self.counting {
            Some(Counting::After(frames)) if arrived - i64::from(self.used()) > frames => {
                self.counting = Some(Counting::Since(idle))
            }
            Some(Counting::Since(before)) => {
                // The number of idle cycles may be smaller than at the report before: a frame written just before a report
                // counts as arrived and executed, although it may not have been. Underruns that were counted are never taken
                // back.
                let new = (idle - before).max(0);
                if new > 0 {
                    // The FIFO had entries before and after this one cycle, so the cycle executed one and is no
                    // underrun. The number of idle cycles is larger now only because the previous report counted a
                    // frame as arrived too early.
                    if !(cycles == 1 && had_entries && self.used() > 0) {
                        self.underruns += new as u64;
                    }
                    self.counting = Some(Counting::Since(idle));
                }
            }
            _ => {}
        }
    }

    /// Switches the counting of underruns on or off. Counting begins when the board executes the next frame that is
    /// written.
    pub fn count_underruns(&mut self, on: bool) {
        self.counting = on.then_some(Counting::After(self.written));
    }

    /// The number of underruns: cycles that found the FIFO empty while counting was on.
    pub const fn underruns(&self) -> u64 {
        self.underruns
    }

    const fn used(&self) -> u16 {
        FIFO_ENTRIES - self.free
    }

    /// The number of frames for which the board certainly has room: the newest free count minus all frames that this
    /// count may not include.
    pub fn credit(&self) -> u16 {
        self.free.saturating_sub(self.uncounted.len() as u16)
    }

    /// The largest possible number of frames that the board has not executed yet.
    pub fn ahead(&self) -> u16 {
        FIFO_ENTRIES - self.credit()
    }

    /// Whether the board has certainly executed frame number `number`. Frames that the newest free count may not
    /// include are taken as not executed.
    pub fn has_executed(&self, number: i64) -> bool {
        self.written - self.uncounted.len() as i64 - i64::from(self.used()) >= number
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// SK-5.11 The credit is the newest free count minus the frames written since.
    #[test]
    fn frames_written_since_the_report_are_taken_off() {
        let mut credit = Credit::new();
        credit.report(Stamp(10 * MS), 150, 1, MS);
        (0..3).for_each(|n| {
            credit.wrote(Stamp(10 * MS + n));
        });
        assert_eq!((credit.credit(), credit.ahead()), (147, 13));
        // This report was made before the three frames were written, and was read late from a queue. They are taken off
        // its free count.
        credit.report(Stamp(9 * MS), 155, 0, MS);
        assert_eq!(credit.credit(), 152);
        credit.report(Stamp(12 * MS), 149, 2, MS);
        assert_eq!(credit.credit(), 149);
    }

    /// SK-5.11 Cycles without an entry are counted, each once, and only after the first frame.
    #[test]
    fn cycles_without_an_entry_count() {
        let mut credit = Credit::new();
        credit.count_underruns(true);
        (1..5).for_each(|n| credit.report(Stamp(n * MS), 160, 1, MS));
        credit.wrote(Stamp(4 * MS + 5));
        credit.report(Stamp(5 * MS), 160, 1, MS);
        assert_eq!(credit.underruns(), 0);
        // One report after two cycles that found the FIFO empty, and another report after a third such cycle.
        credit.report(Stamp(7 * MS), 160, 2, MS);
        credit.report(Stamp(8 * MS), 160, 1, MS);
        assert_eq!(credit.underruns(), 3);
        credit.wrote(Stamp(8 * MS + 5));
        credit.report(Stamp(9 * MS), 160, 1, MS);
        assert_eq!(credit.underruns(), 3);
        credit.count_underruns(false);
        credit.report(Stamp(19 * MS), 160, 10, MS);
        assert_eq!(credit.underruns(), 3);
    }

    /// SK-5.11 A frame that arrives one cycle late causes no underrun while other frames are queued.
    #[test]
    fn a_late_arrival_is_no_underrun() {
        let mut credit = Credit::new();
        credit.count_underruns(true);
        credit.wrote(Stamp(5));
        credit.wrote(Stamp(6));
        credit.report(Stamp(MS), 159, 1, MS);
        credit.wrote(Stamp(2 * MS - 1));
        credit.report(Stamp(2 * MS), 160, 1, MS);
        credit.report(Stamp(3 * MS), 160, 1, MS);
        assert_eq!(credit.underruns(), 0);
    }
}
