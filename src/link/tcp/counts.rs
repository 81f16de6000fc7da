//! A board's counters in messages.

use super::fields::Get;
use super::wire::{Counts, WireError};
use crate::engine::{Counters, Reason};

/// How many counters of [`Counters`] come before those of the rejections.
const BEFORE_REJECTED: usize = 14;

/// All counters of a board, in the order of the message.
pub(super) fn counters(counters: &Counters) -> [u64; BEFORE_REJECTED + Reason::KINDS] {
    let c = counters;
    let plain: [u64; BEFORE_REJECTED] = [
        c.frames,
        c.reports,
        c.ignored_homing,
        c.modes_not_restored,
        c.discarded_before_enabled,
        c.for_lost,
        c.cleared,
        c.full,
        c.crc,
        c.incomplete,
        c.executed,
        c.idle_cycles,
        c.while_booting,
        c.sdo_aborted,
    ];
    std::array::from_fn(|i| plain.get(i).copied().unwrap_or_else(|| c.rejected[i - BEFORE_REJECTED]))
}

pub(super) fn get_counters(get: &mut Get<'_>) -> Result<Counters, WireError> {
    let mut numbers = [0; BEFORE_REJECTED + Reason::KINDS];
    for number in &mut numbers {
        *number = get.u64()?;
    }
    Ok(from_numbers(&numbers))
}

/// The counters from these numbers, which are in the order of [`counters`].
fn from_numbers(numbers: &[u64; BEFORE_REJECTED + Reason::KINDS]) -> Counters {
    let mut of = Counters::default();
    let plain: [&mut u64; BEFORE_REJECTED] = [
        &mut of.frames,
        &mut of.reports,
        &mut of.ignored_homing,
        &mut of.modes_not_restored,
        &mut of.discarded_before_enabled,
        &mut of.for_lost,
        &mut of.cleared,
        &mut of.full,
        &mut of.crc,
        &mut of.incomplete,
        &mut of.executed,
        &mut of.idle_cycles,
        &mut of.while_booting,
        &mut of.sdo_aborted,
    ];
    plain.into_iter().chain(&mut of.rejected).zip(numbers).for_each(|(count, number)| *count = *number);
    of
}

impl Counts {
    /// What was counted since the counters were `before`.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        let board = self.board.zip(before.board).map(|(now, before)| {
            let (now, before) = (counters(&now), counters(&before));
            from_numbers(&std::array::from_fn(|i| now[i].saturating_sub(before[i])))
        });
        Self {
            reports_dropped: self.reports_dropped.saturating_sub(before.reports_dropped),
            board: board.or(self.board),
        }
    }
}
