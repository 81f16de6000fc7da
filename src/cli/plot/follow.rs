//! Which targets were in force when a report was made.
//!
//! A command waits in the FIFO until its cycle, and reports do not say which one that was. But they give the free
//! entries: what was sent and does not wait any more has been executed (SK-5).

use std::collections::VecDeque;

use ecmsk::sk::FIFO_ENTRIES;

use super::MAX_AXES;

/// Target positions, one for each axis of the plot, where there was one.
pub type Targets = [Option<i32>; MAX_AXES];

/// Commands that may wait, and the one executed last.
const KEPT: usize = FIFO_ENTRIES as usize + 1;

/// The commands sent in OP, as far as they may still wait.
#[derive(Debug, Default)]
pub struct Follow {
    /// The targets in force once a command has been executed; the oldest command first.
    sent: VecDeque<Targets>,
    /// Commands sent so far.
    count: u64,
    /// Of commands before this one it is not known which were taken.
    known_from: u64,
    /// Full count and CRC errors of the last report.
    losses: Option<(u16, u8)>,
}

impl Follow {
    /// A command goes by: its targets, and whether it clears the FIFO.
    pub fn command(&mut self, targets: &Targets, clears: bool) {
        let mut in_force = self.sent.back().copied().unwrap_or_default();
        for (old, new) in in_force.iter_mut().zip(targets) {
            *old = new.or(*old);
        }
        if clears {
            // It is the first entry itself; those before it are gone (SK-5).
            self.known_from = self.count;
        }
        if self.sent.len() == KEPT {
            self.sent.pop_front();
        }
        self.sent.push_back(in_force);
        self.count += 1;
    }

    /// A report of OP goes by, with its free entries, full count and count of CRC errors: the targets in force in its
    /// cycle, if that is known. After a loss it is not, until a command sent later has been executed.
    pub fn report(&mut self, free: u16, full_count: u16, crc_errors: u8) -> Option<&Targets> {
        let losses = (full_count, crc_errors);
        if self.losses.replace(losses).is_some_and(|before| before != losses) {
            self.known_from = self.count;
        }
        let waiting = u64::from(FIFO_ENTRIES.saturating_sub(free));
        let last = self.count.saturating_sub(waiting).checked_sub(1)?;
        let oldest = self.count - self.sent.len() as u64;
        for _ in oldest..last {
            self.sent.pop_front();
        }
        if last >= self.known_from { self.sent.front() } else { None }
    }

    /// OP was left: the FIFO is empty and targets are void.
    pub fn reset(&mut self) {
        *self = Self { losses: self.losses, ..Self::default() };
    }
}
