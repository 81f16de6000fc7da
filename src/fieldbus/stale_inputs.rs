//! The age from which the inputs of a slave are stale and the slave is lost, both behind a network card and behind an
//! ECM-XF. `nic/ages.rs` and `xf/watch.rs` count the age.

use super::Ns;

/// How long a slave may be without new inputs: a number of cycles, and a time in ns. When both have passed, its inputs
/// are stale and the slave is lost. \[OURS] In this time the bus searches for the missing slave, so that slaves that
/// only share a datagram with it can continue. The time limit applies only if a search that began in this time has
/// ended; otherwise the time limit is [`STALE_AT_LAST_NS`].
pub const STALE_AFTER: (u32, Ns) = (10, 20_000_000);
/// Time without new inputs, ns, after which the inputs of a slave are stale even if the search for the missing slave
/// (see [`STALE_AFTER`]) has not ended. It equals the timeout of the slaves' watchdogs. \[OURS]
pub const STALE_AT_LAST_NS: Ns = 100_000_000;

/// Whether inputs are stale after `cycles` cycles without new ones. `is_searched`: a search for missing slaves has
/// begun and ended in this time, so the shorter limit applies ([`STALE_AFTER`]); otherwise [`STALE_AT_LAST_NS`]
/// applies.
pub(crate) const fn is_stale(cycles: u32, cycle_ns: Ns, is_searched: bool) -> bool {
    let (least_cycles, least_ns) = STALE_AFTER;
    let time_ns = cycles as Ns * cycle_ns;
    cycles >= least_cycles && (is_searched && time_ns >= least_ns || time_ns >= STALE_AT_LAST_NS)
}
