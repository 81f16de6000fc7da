//! What an axis moves, with the loops that make it follow: a motor with its load, or pulses that are counted.

mod pulses;
mod servo;

pub use pulses::{PulseTrain, Pulses};
pub use servo::{Following, Motor, SIDE_BY_SIDE, SUBSTEP_MAX_NS, Servo, follow_side_by_side};

use crate::ethercat::Ns;

/// What the loops are to do during a span of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// No torque: the shaft coasts, and friction holds it when it stands.
    Coast,
    /// Follow a position that moves evenly.
    Position {
        /// Where it is at the start: whole counts.
        from: i64,
        /// And the rest.
        fraction: f64,
        /// How far it moves, counts.
        by: f64,
    },
    /// Follow a velocity that changes evenly, counts/s.
    Velocity {
        /// At the start.
        from: f64,
        /// At the end.
        to: f64,
    },
    /// Give a torque, as a part of the rated one, as long as the speed stays in its limit.
    Torque(f64),
}

/// The plant of an axis.
#[derive(Clone, Debug)]
pub enum Plant {
    /// A motor with its load.
    Servo(Servo),
    /// A train of pulses.
    Pulses(Pulses),
}

/// What a plant shows of itself after each cycle; see the methods of [`Plant`].
pub(super) struct Shown {
    pub(super) position: i64,
    pub(super) torque: f64,
    pub(super) limited: bool,
}

/// The same question or order to whichever it is.
macro_rules! either {
    ($plant:expr, $it:ident => $what:expr) => {
        match $plant {
            Plant::Servo($it) => $what,
            Plant::Pulses($it) => $what,
        }
    };
}

impl Plant {
    /// Limits of the drive, on top of the motor's: speed in counts/s, torque in 0.1 % of rated.
    pub fn set_limits(&mut self, velocity: u32, torque: u16) {
        match self {
            Self::Servo(servo) => servo.set_limits(velocity, torque),
            Self::Pulses(pulses) => pulses.set_limit(velocity),
        }
    }

    /// End stops of the mechanics: the lowest and the highest count that the shaft can reach. Pulses know of none.
    pub fn set_stops(&mut self, stops: Option<(i64, i64)>) {
        if let Self::Servo(servo) = self {
            servo.set_stops(stops);
        }
    }

    /// The shaft is jammed, or free again. Pulses are counted all the same.
    pub const fn jam(&mut self, jammed: bool) {
        if let Self::Servo(servo) = self {
            servo.jam(jammed);
        }
    }

    /// What the position is more than its whole counts, -0.5..=0.5.
    pub const fn fraction(&self) -> f64 {
        either!(self, it => it.fraction())
    }

    /// Position, torque and limits at once: a cycle asks for all of them.
    pub(super) const fn shown(&self) -> Shown {
        match self {
            Self::Servo(servo) => {
                Shown { position: servo.position(), torque: servo.torque(), limited: servo.is_limited() }
            }
            Self::Pulses(pulses) => Shown { position: pulses.position(), torque: 0.0, limited: pulses.is_limited() },
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

    /// Torque, as a part of the rated one; positive in the direction of counting up.
    pub const fn torque(&self) -> f64 {
        match self {
            Self::Servo(servo) => servo.torque(),
            Self::Pulses(_) => 0.0,
        }
    }

    /// Whether a limit of torque or speed was in force at the end of the last span.
    pub const fn is_limited(&self) -> bool {
        either!(self, it => it.is_limited())
    }

    /// Whether the shaft stands still.
    pub const fn is_at_standstill(&self) -> bool {
        either!(self, it => it.is_at_standstill())
    }

    /// The greatest torque as an acceleration, counts/s²; without bounds where no torque bounds it.
    pub fn torque_as_acceleration(&self) -> f64 {
        match self {
            Self::Servo(servo) => servo.torque_as_acceleration(),
            Self::Pulses(_) => f64::INFINITY,
        }
    }

    /// `ns` pass with that effort. Spans of tens of milliseconds at most keep the fraction fine.
    pub fn run(&mut self, effort: Effort, ns: Ns) {
        either!(self, it => it.run(effort, ns));
    }
}

/// Moves whole counts out of the fraction, which is then in -0.5..0.5.
fn carry(whole: &mut i64, fraction: &mut f64) {
    let shifted = *fraction + 0.5;
    let mut counts = shifted as i64;
    if counts as f64 > shifted {
        counts -= 1;
    }
    *whole = whole.wrapping_add(counts);
    *fraction -= counts as f64;
}

/// `x`, at most `limit` in either direction.
#[inline(always)]
fn within(x: f64, limit: f64) -> f64 {
    at_least(at_most(x, limit), -limit)
}

// Not `f64::min` and `max`: their care for NaN costs time in the innermost loop.
#[inline(always)]
fn at_most(x: f64, limit: f64) -> f64 {
    if x < limit { x } else { limit }
}

#[inline(always)]
fn at_least(x: f64, limit: f64) -> f64 {
    if x > limit { x } else { limit }
}
