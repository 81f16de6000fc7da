//! The encoding of a board's counters in messages.

use super::fields::{Get, Put};
use super::message::Counts;
use super::wire_error::WireError;
use crate::engine::Counters;

/// The number of fields of [`Counters`] that are sent one by one. The counters of rejected commands, one for each reason,
/// follow.
const BEFORE_REJECTED: usize = 21;

/// All counters of a board, in the order in which they are sent.
fn in_order(of: &mut Counters) -> impl Iterator<Item = &mut u64> {
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
        &mut of.sdo_repeated,
        &mut of.answers_lost,
        &mut of.outputs_lost,
        &mut of.cycles_left_out,
        &mut of.ring_broken,
        &mut of.inputs_held,
        &mut of.inputs_stale,
    ];
    plain.into_iter().chain(&mut of.rejected)
}

pub(super) fn put_counters(put: &mut Put<'_>, mut counters: Counters) {
    in_order(&mut counters).for_each(|count| put.u64(*count));
}

pub(super) fn get_counters(get: &mut Get<'_>) -> Result<Counters, WireError> {
    let mut counters = Counters::default();
    for count in in_order(&mut counters) {
        *count = get.u64()?;
    }
    Ok(counters)
}

impl Counts {
    /// How much each counter has increased since `before`, an earlier reading of the same counters.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        let mut since = *self;
        since.reports_dropped = self.reports_dropped.saturating_sub(before.reports_dropped);
        if let (Some(now), Some(mut before)) = (&mut since.board, before.board) {
            in_order(now).zip(in_order(&mut before)).for_each(|(now, before)| *now = now.saturating_sub(*before));
        }
        since
    }
}
