//! How well the distributed clocks of a network keep together.

use std::time::Duration;

use super::{BusError, FoundSlave, Network};
use crate::ethercat::registers::{SYSTEM_TIME_DELAY, SYSTEM_TIME_DIFFERENCE, SYSTEM_TIME_OFFSET, SystemTimeDifference};

/// \[OURS] How often the differences are read.
const INTERVAL: Duration = Duration::from_millis(10);
/// \[OURS] How long clocks that were just set may take to come together before the differences count.
pub const SETTLING: Duration = Duration::from_secs(1);
/// \[OURS] Clocks whose difference stays below this keep together as the standard's examples do, ns.
pub const GOOD_NS: i64 = 1_000;

/// The least, the mean and the greatest of some values, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spread {
    /// The least one.
    pub min_ns: i64,
    /// The mean, rounded towards 0.
    pub mean_ns: i64,
    /// The greatest one.
    pub max_ns: i64,
    /// How many values there are.
    pub count: u32,
}

impl Spread {
    /// The spread of some values; `None`: there are none.
    pub fn of(values: &[i64]) -> Option<Self> {
        let (min_ns, max_ns) = (*values.iter().min()?, *values.iter().max()?);
        let sum: i128 = values.iter().map(|value| i128::from(*value)).sum();
        let mean_ns = (sum / values.len() as i128) as i64;
        Some(Self { min_ns, mean_ns, max_ns, count: u32::try_from(values.len()).unwrap_or(u32::MAX) })
    }

    /// Whether all values are nearer than [`GOOD_NS`].
    pub const fn is_good(&self) -> bool {
        self.min_ns > -GOOD_NS && self.max_ns < GOOD_NS
    }
}

/// The clock of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveClock {
    /// The slave, from 1.
    pub slave: u8,
    /// Its clock is the reference.
    pub is_reference: bool,
    /// What is added to its local time, ns, register 0x0920.
    pub offset_ns: i64,
    /// How long a frame takes from the reference to it, ns, register 0x0928.
    pub delay_ns: u32,
    /// By how much it is ahead of the reference, ns, register 0x092C; `None` for the reference itself.
    pub ahead: Option<Spread>,
}

/// Looks at the clocks for that time, after [`SETTLING`]. Of slaves without clocks nothing is told.
///
/// # Errors
/// [`BusError`]
pub fn measure(network: &mut dyn Network, slaves: &[FoundSlave], time: Duration) -> Result<Vec<SlaveClock>, BusError> {
    let with_clock: Vec<u8> = slaves.iter().filter(|slave| slave.has_clock).map(|slave| slave.slave).collect();
    if with_clock.is_empty() {
        return Ok(Vec::new());
    }
    let reference = network.reference_clock();
    let mut ahead = vec![Vec::new(); with_clock.len()];
    network.wait(SETTLING)?;
    let mut left = time;
    while !left.is_zero() {
        let step = INTERVAL.min(left);
        network.wait(step)?;
        left -= step;
        for (slave, ahead) in with_clock.iter().zip(&mut ahead) {
            if Some(*slave) != reference {
                let mut bytes = [0; 4];
                network.read(*slave, SYSTEM_TIME_DIFFERENCE, &mut bytes)?;
                ahead.push(SystemTimeDifference(u32::from_le_bytes(bytes)).ahead_ns());
            }
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
            ahead: Spread::of(&ahead),
        })
    };
    with_clock.into_iter().zip(ahead).map(clock).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// BUS-6.1 A spread is good if no value is 1 us away, on either side.
    #[test]
    fn a_spread_has_both_ends() {
        let spread = Spread::of(&[-5, 20, 0]).expect("values");
        assert_eq!((spread.min_ns, spread.mean_ns, spread.max_ns, spread.count), (-5, 5, 20, 3));
        assert!(spread.is_good());
        assert_eq!(Spread::of(&[]), None);
        for far in [GOOD_NS, -GOOD_NS, i64::MAX, i64::MIN] {
            assert!(!Spread::of(&[0, far]).expect("values").is_good(), "{far}");
        }
    }
}
