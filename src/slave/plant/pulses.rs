//! A train of pulses: what a stepper driver without feedback is commanded by.
//!
//! \[OURS] The position is the number of pulses sent. They follow the demand without an error, up to the greatest rate;
//! a demand that is faster is caught up with at that rate. Nothing has to slow down: pulses begin and end at once.

use super::{Effort, at_most, carry, within};
use crate::ethercat::Ns;

/// How pulses are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PulseTrain {
    /// Greatest rate, pulses/s; at least 1.
    pub max_rate: u32,
}

impl Default for PulseTrain {
    /// \[OURS] 4 MHz, what differential line drivers carry well.
    fn default() -> Self {
        Self { max_rate: 4_000_000 }
    }
}

/// The plant.
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
    /// A counter that stands at `position`.
    pub fn new(train: &PulseTrain, position: i64) -> Self {
        let max_rate = f64::from(train.max_rate.max(1));
        Self { max_rate, limit: max_rate, whole: position, fraction: 0.0, velocity: 0.0, limited: false }
    }

    /// A limit of the rate, pulses/s, on top of the train's own.
    pub fn set_limit(&mut self, rate: u32) {
        self.limit = at_most(f64::from(rate), self.max_rate);
    }

    /// Pulses sent, those in the negative direction taken off.
    pub const fn position(&self) -> i64 {
        self.whole
    }

    /// What the position is more than whole pulses, -0.5..=0.5.
    pub const fn fraction(&self) -> f64 {
        self.fraction
    }

    /// Rate, pulses/s.
    pub const fn velocity(&self) -> f64 {
        self.velocity
    }

    /// Whether the limit of the rate was in force at the end of the last span.
    pub const fn is_limited(&self) -> bool {
        self.limited
    }

    /// Whether no pulses are sent.
    pub const fn is_at_standstill(&self) -> bool {
        self.velocity == 0.0
    }

    /// `ns` pass with that effort.
    pub fn run(&mut self, effort: Effort, ns: Ns) {
        if ns == 0 {
            return;
        }
        let seconds = ns as f64 / 1e9;
        let (asked, by, velocity) = match effort {
            Effort::Coast | Effort::Torque(_) => (0.0, 0.0, 0.0),
            Effort::Position { from, fraction, by } => {
                // Both are near the counter, so the difference is exact.
                let way = (from.wrapping_sub(self.whole) as f64 + (fraction - self.fraction)) + by;
                let given = within(way, self.limit * seconds);
                (way, given, given / seconds)
            }
            Effort::Velocity { from, to } => {
                let (first, last) = (within(from, self.limit), within(to, self.limit));
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
