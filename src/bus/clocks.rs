//! Measures how well the distributed clocks of a network are synchronized.

use std::time::{Duration, Instant};

use super::{BusError, FoundSlave, Network};
use crate::ethercat::registers::{
    AL_STATUS, SYSTEM_TIME_DELAY, SYSTEM_TIME_DIFFERENCE, SYSTEM_TIME_OFFSET, SystemTimeDifference,
};

/// \[OURS] Interval at which the differences of the clocks are read.
const INTERVAL: Duration = Duration::from_millis(10);
/// \[OURS] Shortest time that clocks get to synchronize after they were set. Differences are recorded only after it.
pub const SETTLING: Duration = Duration::from_secs(1);
/// \[OURS] Longest time that clocks get to synchronize, while one of them differs from the reference by [`GOOD_NS`] or
/// more. They drift apart during the scan, and a slave corrects its clock slowly.
pub const SETTLING_MAX: Duration = Duration::from_secs(10);
/// \[OURS] A wait that lasts this much longer than requested means that this machine stalled. The slaves got no
/// reference time meanwhile, so the differences after it are not counted.
const STALL_MIN: Duration = Duration::from_millis(2);
/// \[OURS] Number of consecutive readings in which all clocks must be below [`GOOD_NS`] to count as synchronized.
const SETTLED_READINGS: u32 = 20;
/// \[OURS] Largest difference of a synchronized clock, ns: below 1 us, as in the standard's examples.
pub const GOOD_NS: i64 = 1_000;

/// Minimum, mean and maximum of the measured differences of a clock, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockSpread {
    /// The minimum, ns.
    pub min_ns: i64,
    /// The mean, ns, rounded towards 0.
    pub mean_ns: i64,
    /// The maximum, ns.
    pub max_ns: i64,
    /// The number of measured differences.
    pub count: u32,
}

impl ClockSpread {
    /// The minimum, mean and maximum of these values, ns; `None` if there are none.
    pub fn of(values: &[i64]) -> Option<Self> {
        let (min_ns, max_ns) = (*values.iter().min()?, *values.iter().max()?);
        let sum: i128 = values.iter().map(|value| i128::from(*value)).sum();
        let mean_ns = (sum / values.len() as i128) as i64;
        Some(Self { min_ns, mean_ns, max_ns, count: u32::try_from(values.len()).unwrap_or(u32::MAX) })
    }

    /// Whether the absolute values of all differences are below [`GOOD_NS`].
    pub const fn is_good(&self) -> bool {
        self.min_ns > -GOOD_NS && self.max_ns < GOOD_NS
    }
}

/// The clock of a slave, and how far it was from the reference clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveClock {
    /// The slave, from 1 in network order.
    pub slave: u8,
    /// Whether this clock is the reference clock.
    pub is_reference: bool,
    /// The offset that the slave adds to its local time, ns, register 0x0920.
    pub offset_ns: i64,
    /// The propagation delay from the reference clock to the slave, ns, register 0x0928.
    pub delay_ns: u32,
    /// How far the clock was ahead of the reference clock, ns, register 0x092C; `None` for the reference clock itself.
    pub ahead: Option<ClockSpread>,
}

/// Measures the differences of the clocks for this time, once they are synchronized ([`SETTLING`], [`SETTLING_MAX`]). The
/// result leaves out slaves without clocks, and those whose controllers have no register for the difference.
///
/// # Errors
/// A slave's clock registers cannot be read ([`BusError::Register`]), or the network fails during a wait.
pub fn measure(network: &mut dyn Network, slaves: &[FoundSlave], time: Duration) -> Result<Vec<SlaveClock>, BusError> {
    let mut with_clock = Vec::new();
    for FoundSlave { slave, .. } in slaves.iter().filter(|slave| slave.has_clock) {
        if shows_difference(network, *slave)? {
            with_clock.push(*slave);
        }
    }
    if with_clock.is_empty() {
        return Ok(Vec::new());
    }
    let reference = network.reference_clock();
    let mut ahead = vec![Vec::new(); with_clock.len()];
    let look = |network: &mut dyn Network, tell: &mut dyn FnMut(usize, i64)| {
        for (n, slave) in with_clock.iter().enumerate().filter(|(_, slave)| Some(**slave) != reference) {
            let mut bytes = [0; 4];
            network.read(*slave, SYSTEM_TIME_DIFFERENCE, &mut bytes)?;
            tell(n, SystemTimeDifference(u32::from_le_bytes(bytes)).ahead_ns());
        }
        Ok::<(), BusError>(())
    };
    network.wait(SETTLING)?;
    let (mut waited, mut settled) = (SETTLING, 0);
    while settled < SETTLED_READINGS && waited < SETTLING_MAX {
        let mut are_near = true;
        look(network, &mut |_, ahead_ns| are_near &= ahead_ns.abs() < GOOD_NS)?;
        settled = if are_near { settled + 1 } else { 0 };
        network.wait(INTERVAL)?;
        waited += INTERVAL;
    }
    let mut left = time;
    // How many readings are still skipped after a stall of this machine. They give the clocks time to get synchronized
    // again.
    let mut unsettled = 0;
    while !left.is_zero() {
        let step = INTERVAL.min(left);
        let began = Instant::now();
        network.wait(step)?;
        left -= step;
        let is_late = !network.is_virtual() && began.elapsed() > step + STALL_MIN;
        unsettled = if is_late { SETTLED_READINGS } else { unsettled.saturating_sub(1) };
        if unsettled == 0 {
            look(network, &mut |n, ahead_ns| ahead[n].push(ahead_ns))?;
        }
    }
    let clock = |(slave, ahead): (u8, Vec<i64>)| {
        let (mut offset, mut delay) = ([0; 8], [0; 4]);
        network.read(slave, SYSTEM_TIME_OFFSET, &mut offset)?;
        network.read(slave, SYSTEM_TIME_DELAY, &mut delay)?;
        Ok(SlaveClock {
            slave,
            is_reference: Some(slave) == reference,
            offset_ns: i64::from_le_bytes(offset),
            delay_ns: u32::from_le_bytes(delay),
            ahead: ClockSpread::of(&ahead),
        })
    };
    with_clock.into_iter().zip(ahead).map(clock).collect()
}

/// Whether a slave has the register of its clock's difference.
fn shows_difference(network: &mut dyn Network, slave: u8) -> Result<bool, BusError> {
    match network.read(slave, SYSTEM_TIME_DIFFERENCE, &mut [0; 4]) {
        Ok(()) => Ok(true),
        // A slave that is gone does not have its other registers either.
        Err(BusError::Register { .. }) if network.read(slave, AL_STATUS, &mut [0; 2]).is_ok() => Ok(false),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A spread is good if every value is less than 1 us away from 0, in both directions.
    #[test]
    fn a_spread_has_both_ends() {
        let spread = ClockSpread::of(&[-5, 20, 0]).expect("values");
        assert_eq!((spread.min_ns, spread.mean_ns, spread.max_ns, spread.count), (-5, 5, 20, 3));
        assert!(spread.is_good());
        assert_eq!(ClockSpread::of(&[]), None);
        for far in [GOOD_NS, -GOOD_NS, i64::MAX, i64::MIN] {
            assert!(!ClockSpread::of(&[0, far]).expect("values").is_good(), "{far}");
        }
    }
}
