//! A pulse train that commands a stepper driver without feedback.
//!
//! \[OURS] The position is the number of pulses sent. It follows the demand without error up to the maximum rate; after a
//! faster demand the pulses catch up at the maximum rate. Pulses start and stop without a ramp.

use super::{Setpoint, at_most, carry, clamp_to};
use crate::ethercat::Ns;

/// The configuration of a pulse train.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PulseTrain {
    /// The maximum rate, pulses/s; at least 1.
    pub max_rate: u32,
}

impl Default for PulseTrain {
    /// \[OURS] 4 MHz, a rate that differential line drivers transmit well.
    fn default() -> Self {
        Self { max_rate: 4_000_000 }
    }
}

/// A pulse train as the plant of an axis.
#[derive(Clone, Debug)]
pub struct Pulses {
    max_rate: f64,
    limit: f64,
    whole: i64,
    fraction: f64,
    velocity: f64,
    limited: bool,
}

impl Pulses {
    /// A pulse train that starts at `position`, pulses.
    pub fn new(train: &PulseTrain, position: i64) -> Self {
        let max_rate = f64::from(train.max_rate.max(1));
        Self { max_rate, limit: max_rate, whole: position, fraction: 0.0, velocity: 0.0, limited: false }
    }

    /// Sets a limit of the rate, pulses/s, in addition to the maximum rate.
    pub fn set_limit(&mut self, rate: u32) {
        self.limit = at_most(f64::from(rate), self.max_rate);
    }

    /// The number of pulses sent; pulses in the negative direction count negatively.
    pub const fn position(&self) -> i64 {
        self.whole
    }

    /// The fraction of a pulse to add to [`Self::position`], -0.5..=0.5.
    pub const fn fraction(&self) -> f64 {
        self.fraction
    }

    /// The rate, pulses/s.
    pub const fn velocity(&self) -> f64 {
        self.velocity
    }

    /// Whether the maximum rate or the drive's limit reduced the rate in the last period.
    pub const fn is_limited(&self) -> bool {
        self.limited
    }

    /// Whether no pulses are sent.
    pub const fn is_at_standstill(&self) -> bool {
        self.velocity == 0.0
    }

    /// Generates pulses for `ns` according to a setpoint.
    pub fn run(&mut self, setpoint: Setpoint, ns: Ns) {
        if ns == 0 {
            return;
        }
        let seconds = ns as f64 / 1e9;
        let (asked, by, velocity) = match setpoint {
            Setpoint::Coast | Setpoint::Torque(_) => (0.0, 0.0, 0.0),
            Setpoint::Position { from, fraction, by } => {
                // `from` and the position are close to each other, so `f64` holds their difference exactly.
                let way = (from.wrapping_sub(self.whole) as f64 + (fraction - self.fraction)) + by;
                let given = clamp_to(way, self.limit * seconds);
                (way, given, given / seconds)
            }
            Setpoint::Velocity { from, to } => {
                let (first, last) = (clamp_to(from, self.limit), clamp_to(to, self.limit));
                let asked = (from + to) * 0.5 * seconds;
                (asked, (first + last) * 0.5 * seconds, last)
            }
        };
        self.limited = by != asked;
        self.velocity = velocity;
        self.fraction += by;
        carry(&mut self.whole, &mut self.fraction);
    }
}
