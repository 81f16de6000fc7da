//! The physics of an axis: a motor with its load and control loops (`plant/servo.rs`), or a counted pulse train
//! (`plant/pulses.rs`).

mod pulses;
mod servo;

pub use pulses::{PulseTrain, Pulses};
pub use servo::{Motor, SIDE_BY_SIDE, SUBSTEP_MAX_NS, Servo, follow_side_by_side};

use crate::ethercat::Ns;

/// The setpoint of the drive's control loops for one call of [`Plant::run`], usually a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setpoint {
    /// No torque: the shaft coasts to a standstill and is then held by friction.
    Coast,
    /// A position that moves at constant velocity.
    Position {
        /// The position at the start of the period, whole counts.
        from: i64,
        /// The fraction of a count to add to `from`.
        fraction: f64,
        /// The distance that the position moves in the period, counts.
        by: f64,
    },
    /// A velocity that changes at a constant rate.
    Velocity {
        /// The velocity at the start of the period, counts/s.
        from: f64,
        /// The velocity at the end of the period, counts/s.
        to: f64,
    },
    /// A torque, as a fraction of the rated torque. It is reduced where the shaft would exceed the speed limit.
    Torque(f64),
}

/// What an axis moves: the shaft of a motor, or a count of pulses.
#[derive(Clone, Debug)]
pub enum Plant {
    /// A motor with its load.
    Servo(Servo),
    /// A pulse train for a stepper driver.
    Pulses(Pulses),
}

/// The values that an axis reads from its plant after each step; see the methods of [`Plant`].
pub(super) struct PlantReading {
    pub(super) position: i64,
    pub(super) torque: f64,
    pub(super) limited: bool,
}

/// Evaluates an expression with the servo or the pulse train of a plant: `either!(plant, name => expression of name)`.
macro_rules! either {
    ($plant:expr, $it:ident => $what:expr) => {
        match $plant {
            Plant::Servo($it) => $what,
            Plant::Pulses($it) => $what,
        }
    };
}

impl Plant {
    /// Sets the limits of the drive, in addition to those of the motor: speed in counts/s, torque in 0.1 % of rated.
    pub fn set_limits(&mut self, velocity: u32, torque: u16) {
        match self {
            Self::Servo(servo) => servo.set_limits(velocity, torque),
            Self::Pulses(pulses) => pulses.set_limit(velocity),
        }
    }

    /// Sets the mechanical end stops: the lowest and the highest count that the shaft can reach. Pulses have no end stops.
    pub fn set_stops(&mut self, stops: Option<(i64, i64)>) {
        if let Self::Servo(servo) = self {
            servo.set_stops(stops);
        }
    }

    /// Blocks the shaft, or frees it. Pulses are counted regardless.
    pub const fn jam(&mut self, jammed: bool) {
        if let Self::Servo(servo) = self {
            servo.jam(jammed);
        }
    }

    /// The fraction of a count to add to [`Self::position`], -0.5..=0.5.
    pub const fn fraction(&self) -> f64 {
        either!(self, it => it.fraction())
    }

    /// Position, torque and limit state in one call, because every cycle needs all of them.
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

    /// The actual position of the shaft, or the number of pulses sent, whole counts.
    pub const fn position(&self) -> i64 {
        either!(self, it => it.position())
    }

    /// The actual velocity of the shaft, or the rate of the pulses, counts/s.
    pub const fn velocity(&self) -> f64 {
        either!(self, it => it.velocity())
    }

    /// The velocity of the last position setpoint, counts/s. For a pulse train it is the actual velocity, which is the same
    /// unless the rate is limited.
    pub const fn demanded_velocity(&self) -> f64 {
        match self {
            Self::Servo(servo) => servo.demanded_velocity(),
            Self::Pulses(pulses) => pulses.velocity(),
        }
    }

    /// The torque, as a fraction of the rated torque; positive in the direction of increasing counts.
    pub const fn torque(&self) -> f64 {
        match self {
            Self::Servo(servo) => servo.torque(),
            Self::Pulses(_) => 0.0,
        }
    }

    /// Whether the shaft is at standstill.
    pub const fn is_at_standstill(&self) -> bool {
        either!(self, it => it.is_at_standstill())
    }

    /// The acceleration at the maximum torque, counts/s²; infinite for pulses.
    pub fn torque_as_acceleration(&self) -> f64 {
        match self {
            Self::Servo(servo) => servo.torque_as_acceleration(),
            Self::Pulses(_) => f64::INFINITY,
        }
    }

    /// Runs the plant for `ns` with a setpoint. In a period of more than some tens of milliseconds the fraction of a count
    /// loses precision, because the whole distance is added to it before whole counts are carried.
    pub fn run(&mut self, setpoint: Setpoint, ns: Ns) {
        either!(self, it => it.run(setpoint, ns));
    }
}

/// Carries whole counts from the fraction to `whole`, so that the fraction is in -0.5..0.5.
fn carry(whole: &mut i64, fraction: &mut f64) {
    let shifted = *fraction + 0.5;
    let mut counts = shifted as i64;
    if counts as f64 > shifted {
        counts -= 1;
    }
    *whole = whole.wrapping_add(counts);
    *fraction -= counts as f64;
}

/// `x`, clamped to `-limit..=limit`.
#[inline(always)]
fn clamp_to(x: f64, limit: f64) -> f64 {
    at_least(at_most(x, limit), -limit)
}

// Not `f64::min` and `max`: their handling of NaN costs time in the innermost loop. Here NaN becomes `limit`.
#[inline(always)]
fn at_most(x: f64, limit: f64) -> f64 {
    if x < limit { x } else { limit }
}

#[inline(always)]
fn at_least(x: f64, limit: f64) -> f64 {
    if x > limit { x } else { limit }
}
