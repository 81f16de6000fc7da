//! The physics of an axis: a motor with its load and control loops (`plant/servo.rs`), or a train of pulses that are
//! counted (`plant/pulses.rs`).

mod pulses;
mod servo;

pub use pulses::{PulseTrain, Pulses};
pub use servo::{Motor, SIDE_BY_SIDE, SUBSTEP_MAX_NS, Servo, follow_side_by_side};

use crate::ethercat::Ns;

/// What the control loops have to follow during a span of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setpoint {
    /// No torque: the shaft coasts, and friction holds it when it stands.
    Coast,
    /// A position that moves evenly.
    Position {
        /// The position at the start of the span, whole counts.
        from: i64,
        /// The fraction of a count that the position at the start has on top of them.
        fraction: f64,
        /// The distance that the position moves, counts.
        by: f64,
    },
    /// A velocity that changes evenly.
    Velocity {
        /// The velocity at the start of the span, counts/s.
        from: f64,
        /// The velocity at the end of the span, counts/s.
        to: f64,
    },
    /// A torque, as a part of the rated one, as long as the speed stays within its limit.
    Torque(f64),
}

/// What an axis moves.
#[derive(Clone, Debug)]
pub enum Plant {
    /// A motor with its load.
    Servo(Servo),
    /// A train of pulses for a stepper driver.
    Pulses(Pulses),
}

/// What an axis reads from its plant after each step; see the methods of [`Plant`].
pub(super) struct PlantReading {
    pub(super) position: i64,
    pub(super) torque: f64,
    pub(super) limited: bool,
}

/// Calls the same method of whichever plant it is.
macro_rules! either {
    ($plant:expr, $it:ident => $what:expr) => {
        match $plant {
            Plant::Servo($it) => $what,
            Plant::Pulses($it) => $what,
        }
    };
}

impl Plant {
    /// Sets the limits of the drive, which apply besides those of the motor: speed in counts/s, torque in 0.1 % of rated.
    pub fn set_limits(&mut self, velocity: u32, torque: u16) {
        match self {
            Self::Servo(servo) => servo.set_limits(velocity, torque),
            Self::Pulses(pulses) => pulses.set_limit(velocity),
        }
    }

    /// Sets the mechanical end stops: the lowest and the highest count that the shaft can reach. Pulses have none.
    pub fn set_stops(&mut self, stops: Option<(i64, i64)>) {
        if let Self::Servo(servo) = self {
            servo.set_stops(stops);
        }
    }

    /// Jams the shaft, or frees it. Pulses are counted all the same.
    pub const fn jam(&mut self, jammed: bool) {
        if let Self::Servo(servo) = self {
            servo.jam(jammed);
        }
    }

    /// The fraction of a count that the position has on top of its whole counts, -0.5..=0.5.
    pub const fn fraction(&self) -> f64 {
        either!(self, it => it.fraction())
    }

    /// Position, torque and limits in one call, since every cycle needs them all.
    pub(super) const fn reading(&self) -> PlantReading {
        match self {
            Self::Servo(servo) => {
                PlantReading { position: servo.position(), torque: servo.torque(), limited: servo.is_limited() }
            }
            Self::Pulses(pulses) => {
                PlantReading { position: pulses.position(), torque: 0.0, limited: pulses.is_limited() }
            }
        }
    }

    /// Position, counts.
    pub const fn position(&self) -> i64 {
        either!(self, it => it.position())
    }

    /// Velocity, counts/s.
    pub const fn velocity(&self) -> f64 {
        either!(self, it => it.velocity())
    }

    /// The velocity of the position that was followed last, counts/s. Pulses follow it without an error.
    pub const fn demanded_velocity(&self) -> f64 {
        match self {
            Self::Servo(servo) => servo.demanded_velocity(),
            Self::Pulses(pulses) => pulses.velocity(),
        }
    }

    /// Torque, as a part of the rated one; positive in the direction of counting up.
    pub const fn torque(&self) -> f64 {
        match self {
            Self::Servo(servo) => servo.torque(),
            Self::Pulses(_) => 0.0,
        }
    }

    /// Whether the shaft stands still.
    pub const fn is_at_standstill(&self) -> bool {
        either!(self, it => it.is_at_standstill())
    }

    /// The acceleration that the greatest torque gives, counts/s²; infinite for pulses.
    pub fn torque_as_acceleration(&self) -> f64 {
        match self {
            Self::Servo(servo) => servo.torque_as_acceleration(),
            Self::Pulses(_) => f64::INFINITY,
        }
    }

    /// `ns` pass with that setpoint. Spans of tens of milliseconds at most keep the fraction precise.
    pub fn run(&mut self, setpoint: Setpoint, ns: Ns) {
        either!(self, it => it.run(setpoint, ns));
    }
}

/// Moves whole counts from the fraction to `whole`, so that the fraction is in -0.5..0.5.
fn carry(whole: &mut i64, fraction: &mut f64) {
    let shifted = *fraction + 0.5;
    let mut counts = shifted as i64;
    if counts as f64 > shifted {
        counts -= 1;
    }
    *whole = whole.wrapping_add(counts);
    *fraction -= counts as f64;
}

/// `x` clamped to `-limit..=limit`.
#[inline(always)]
fn clamp_to(x: f64, limit: f64) -> f64 {
    at_least(at_most(x, limit), -limit)
}

// `f64::min` and `max` treat NaN, which costs time in the innermost loop.
#[inline(always)]
fn at_most(x: f64, limit: f64) -> f64 {
    if x < limit { x } else { limit }
}

#[inline(always)]
fn at_least(x: f64, limit: f64) -> f64 {
    if x > limit { x } else { limit }
}
