//! How old the inputs of a slave may be until they are stale and the slave is lost, on a network card and behind a chip.
//! `nic/ages.rs` and `xf/watch.rs` count their age.

use super::Ns;

/// How long a slave may be without new inputs: a number of cycles, and a time in ns. When both have passed, its inputs
/// are stale and the slave is lost. \[OURS] In this time the bus searches for the missing slave, so that slaves that
/// only share a datagram with it can continue. Until a search that began in this time has ended, the time
/// [`STALE_AT_LAST_NS`] applies instead.
pub const STALE_AFTER: (u32, Ns) = (10, 20_000_000);
/// Time without new inputs, ns, after which the inputs of a slave are stale even if the search for the missing slave,
/// which [`STALE_AFTER`] waits for, has not ended. It is the timeout of the slaves' watchdogs. \[OURS]
pub const STALE_AT_LAST_NS: Ns = 100_000_000;

/// Whether inputs are stale after `cycles` cycles without new ones. `is_searched`: a search for missing slaves has
/// begun and ended in this time, so the shorter limit applies ([`STALE_AFTER`]); otherwise [`STALE_AT_LAST_NS`]
/// applies.
pub(crate) const fn is_stale(cycles: u32, cycle_ns: Ns, is_searched: bool) -> bool {
    let (least_cycles, least_ns) = STALE_AFTER;
    let time_ns = cycles as Ns * cycle_ns;
    cycles >= least_cycles && (is_searched && time_ns >= least_ns || time_ns >= STALE_AT_LAST_NS)
}
