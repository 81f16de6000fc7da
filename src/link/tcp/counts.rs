//! A board's counters as they travel.

use super::fields::Get;
use super::wire::WireError;
use crate::engine::{Counters, Reason};

/// Numbers of [`Counters`] besides the rejections.
const PLAIN: usize = 13;

/// Every number of a board's counters, in the order of the wire.
pub(super) fn counters(counters: &Counters) -> [u64; PLAIN + Reason::KINDS] {
    let c = counters;
    let plain: [u64; PLAIN] = [
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
    ];
    std::array::from_fn(|i| plain.get(i).copied().unwrap_or_else(|| c.rejected[i - PLAIN]))
}

pub(super) fn get_counters(get: &mut Get<'_>) -> Result<Counters, WireError> {
    let mut counters = Counters {
        frames: get.u64()?,
        reports: get.u64()?,
        ignored_homing: get.u64()?,
        modes_not_restored: get.u64()?,
        discarded_before_enabled: get.u64()?,
        for_lost: get.u64()?,
        cleared: get.u64()?,
        full: get.u64()?,
        crc: get.u64()?,
        incomplete: get.u64()?,
        executed: get.u64()?,
        idle_cycles: get.u64()?,
        while_booting: get.u64()?,
        ..Counters::default()
    };
    for count in &mut counters.rejected {
        *count = get.u64()?;
    }
    Ok(counters)
}
