//! The motor with its shaft and load, and the drive's cascade of position loop and velocity loop.
//!
//! The shaft is rigid and has inertia, viscous friction and dry friction; the driving torque is limited. Time is divided
//! into sub-steps of at most [`SUBSTEP_MAX_NS`], for which the loops are stable, so a cycle may have any length. Dry
//! friction is modelled as an impulse that can at most stop the shaft, viscous friction implicitly: neither can make the
//! shaft oscillate.
//!
//! Positions are in counts, stored as a whole `i64` and a fraction. So an axis can turn in one direction endlessly, and its
//! position is as precise far away as near 0. [`Servo::position`] is the whole part, rounded. All calculations are
//! `+ - * /` of `f64` and conversions between `f64` and integers, which give the same bits on every target.

mod side_by_side;

pub use side_by_side::{SIDE_BY_SIDE, follow_side_by_side};

use super::{Setpoint, at_least, at_most, carry, clamp_to};
use crate::ethercat::Ns;

/// \[OURS] The maximum length of a sub-step, ns: the cascade runs at 4 kHz at least, as in a small servo drive.
pub const SUBSTEP_MAX_NS: Ns = 250_000;

/// \[OURS] The drive adds a torque in the direction of the demanded speed that compensates dry friction. Below this
/// demanded speed, counts/s, the added torque is proportional to the speed: the full torque would push a shaft that has
/// stopped at its target.
const FRICTION_FADE: f64 = 10.0;

/// \[OURS] The speed below which a shaft counts as at standstill, counts/s.
const STANDSTILL: f64 = 1.0;

/// The range of counts of a shaft without end stops.
const NO_STOPS: (i64, i64) = (i64::MIN, i64::MAX);

/// A motor with its load, and the gains of its drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Motor {
    /// Counts per turn.
    pub counts_per_turn: u32,
    /// Rated torque, mN m (0x6076).
    pub rated_torque: u32,
    /// The acceleration of motor and load at the rated torque, counts/s²; at least 1.
    pub rated_acceleration: u32,
    /// The maximum torque, 0.1 % of rated.
    pub peak_torque: u16,
    /// The maximum speed, counts/s; at least 1.
    pub max_velocity: u32,
    /// The torque of dry friction, 0.1 % of rated.
    pub dry_friction: u16,
    /// The torque of viscous friction at the maximum speed, 0.1 % of rated.
    pub viscous_friction: u16,
    /// Gain of the position loop, 1/s; up to 1000.
    pub position_gain: u16,
    /// Gain of the velocity loop, 1/s; up to 2000, and several times the gain of the position loop.
    pub velocity_gain: u16,
}

impl Default for Motor {
    /// \[OURS] A 400 W servo motor with a 17-bit encoder, a load of five times its own inertia, 1.27 N m rated torque, 300
    /// % peak torque and 6000 rpm.
    fn default() -> Self {
        Self {
            counts_per_turn: 1 << 17,
            rated_torque: 1270,
            rated_acceleration: 165_000_000,
            peak_torque: 3000,
            max_velocity: 100 << 17,
            dry_friction: 30,
            viscous_friction: 100,
            position_gain: 100,
            velocity_gain: 800,
        }
    }
}

impl Motor {
    /// \[OURS] A closed-loop NEMA 23 stepper with an encoder of 10000 counts per turn and a load of twice its own inertia. Its
    /// rated torque of 2 N m is also its maximum; its maximum speed is 3000 rpm.
    pub const fn stepper() -> Self {
        Self {
            counts_per_turn: 10_000,
            rated_torque: 2000,
            rated_acceleration: 35_000_000,
            peak_torque: 1000,
            max_velocity: 500_000,
            dry_friction: 30,
            viscous_friction: 100,
            position_gain: 100,
            velocity_gain: 800,
        }
    }
}

/// Constants that a setpoint period needs (one call of [`Servo::run`]). They are computed again only if the length of the
/// period or a limit changes.
#[derive(Clone, Copy, Debug, Default)]
struct Span {
    ns: Ns,
    substeps: u32,
    /// The length of a sub-step, seconds.
    substep_s: f64,
    /// 1 / number of sub-steps: the share of the setpoint's motion in one sub-step.
    share: f64,
    /// 1 / length of the period, 1/s.
    rate: f64,
    /// Gain of the velocity loop for the actual speed: the change of speed in a sub-step, counts/s, for each count/s of actual
    /// speed.
    gain: f64,
    /// Gain of the velocity loop for the demanded speed: the change of speed in a sub-step, counts/s, for each count/s of
    /// demanded speed. It is larger than `gain`, because it includes the compensation of viscous friction.
    gain_wanted: f64,
    /// The torque limit, as the maximum change of speed in a sub-step, counts/s.
    torque: f64,
    /// The change of speed in a sub-step due to dry friction, counts/s.
    friction: f64,
    /// Gain of the compensation of dry friction: the change of speed in a sub-step, counts/s, for each count/s of demanded
    /// speed. The result is limited to `friction`.
    friction_wanted: f64,
    /// The fraction of the speed that remains after viscous friction has acted for a sub-step.
    decay: f64,
    /// The torque, as a fraction of the rated torque, that changes the speed by 1 count/s in one sub-step.
    torque_per_change: f64,
}

/// The position setpoint of a motor for one period.
#[derive(Clone, Copy, Debug, Default)]
struct Way {
    /// The position at the start of the period, counts relative to the whole part of the shaft's position at that time.
    start: f64,
    /// The distance in the period, counts.
    by: f64,
}

/// A motor with its load as the plant of an axis.
#[derive(Clone, Debug)]
#[repr(C)] // The fields that each cycle uses are adjacent, at the beginning.
pub struct Servo {
    whole: i64,
    fraction: f64,
    velocity: f64,
    torque: f64,
    limited: bool,
    jammed: bool,
    position_gain: f64,
    velocity_limit: f64,
    /// The lowest and the highest count that the shaft can reach.
    stops: (i64, i64),
    span: Span,
    /// The setpoint of the present period, see [`Self::aim_at`].
    way: Way,
    acceleration: f64,
    peak_torque: f64,
    max_velocity: f64,
    dry_friction: f64,
    viscous_rate: f64,
    velocity_gain: f64,
    torque_limit: f64,
}

impl Servo {
    /// A motor at standstill with its shaft at `position`, counts.
    pub fn new(motor: &Motor, position: i64) -> Self {
        let acceleration = f64::from(motor.rated_acceleration.max(1));
        let max_velocity = f64::from(motor.max_velocity.max(1));
        let peak_torque = f64::from(motor.peak_torque) / 1000.0;
        Self {
            acceleration,
            peak_torque,
            max_velocity,
            dry_friction: f64::from(motor.dry_friction) / 1000.0,
            viscous_rate: f64::from(motor.viscous_friction) / 1000.0 * acceleration / max_velocity,
            position_gain: f64::from(motor.position_gain.min(1000)),
            velocity_gain: f64::from(motor.velocity_gain.min(2000)),
            velocity_limit: max_velocity,
            torque_limit: peak_torque,
            span: Span::default(),
            whole: position,
            way: Way::default(),
            fraction: 0.0,
            velocity: 0.0,
            torque: 0.0,
            limited: false,
            stops: NO_STOPS,
            jammed: false,
        }
    }

    /// Sets the mechanical end stops: the lowest and the highest count that the shaft can reach. The shaft stops there
    /// immediately. `None`: there are no end stops.
    pub fn set_stops(&mut self, stops: Option<(i64, i64)>) {
        self.stops = stops.unwrap_or(NO_STOPS);
    }

    /// Blocks the shaft, so that it does not move whatever the torque, or frees it.
    pub const fn jam(&mut self, jammed: bool) {
        self.jammed = jammed;
        self.span.ns = 0;
    }

    /// Sets the limits of the drive, in addition to those of the motor: speed in counts/s, torque in 0.1 % of rated.
    pub fn set_limits(&mut self, velocity: u32, torque: u16) {
        self.velocity_limit = at_most(f64::from(velocity), self.max_velocity);
        self.torque_limit = at_most(f64::from(torque) / 1000.0, self.peak_torque);
        self.span.ns = 0;
    }

    /// The actual position of the shaft, whole counts.
    pub const fn position(&self) -> i64 {
        self.whole
    }

    /// The fraction of a count to add to [`Self::position`], -0.5..=0.5.
    pub const fn fraction(&self) -> f64 {
        self.fraction
    }

    /// The actual velocity of the shaft, counts/s.
    pub const fn velocity(&self) -> f64 {
        self.velocity
    }

    /// The velocity of the last position setpoint, counts/s.
    pub const fn demanded_velocity(&self) -> f64 {
        self.way.by * self.span.rate
    }

    /// The torque, as a fraction of the rated torque; positive in the direction of increasing counts.
    pub const fn torque(&self) -> f64 {
        self.torque
    }

    /// Whether torque or speed was limited in the last sub-step of the last period.
    pub const fn is_limited(&self) -> bool {
        self.limited
    }

    /// Whether the shaft is at standstill.
    pub const fn is_at_standstill(&self) -> bool {
        -STANDSTILL < self.velocity && self.velocity < STANDSTILL
    }

    /// The acceleration at the maximum torque, counts/s².
    pub fn torque_as_acceleration(&self) -> f64 {
        self.torque_limit * self.acceleration
    }

    /// Sets the position setpoint, see [`Setpoint::Position`], for a motor that [`follow_side_by_side`] runs in the next
    /// period.
    #[inline]
    pub const fn aim_at(&mut self, from: i64, fraction: f64, by: f64) {
        self.way = self.way_of(from, fraction, by);
    }

    #[inline]
    const fn way_of(&self, from: i64, fraction: f64, by: f64) -> Way {
        // `from` and the position are close to each other, so `f64` holds their difference exactly.
        Way { start: from.wrapping_sub(self.whole) as f64 + fraction, by }
    }

    /// Runs the motor for `ns` with a setpoint. In a period of more than some tens of milliseconds the fraction of a count
    /// loses precision, because the whole distance is added to it before whole counts are carried.
    pub fn run(&mut self, setpoint: Setpoint, ns: Ns) {
        if ns == 0 {
            return;
        }
        self.set_span(ns);
        let span = self.span;
        match setpoint {
            Setpoint::Coast => self.coast(&span),
            Setpoint::Position { from, fraction, by } => {
                self.aim_at(from, fraction, by);
                self.follow_position(&span, self.way);
            }
            Setpoint::Velocity { from, to } => self.follow_velocity(&span, from, to),
            Setpoint::Torque(torque) => self.follow_torque(&span, torque),
        }
        self.settle();
    }

    /// Updates the precomputed constants for a period of `ns`.
    #[inline]
    fn set_span(&mut self, ns: Ns) {
        if self.span.ns != ns {
            self.span = self.span_of(ns);
        }
    }

    /// Ends a period: moves whole counts from the fraction to the whole part of the position, and stops the shaft at an end
    /// stop.
    #[inline]
    fn settle(&mut self) {
        carry(&mut self.whole, &mut self.fraction);
        if self.whole < self.stops.0 || self.whole > self.stops.1 {
            self.stop_at_end();
        }
    }

    #[cold]
    fn stop_at_end(&mut self) {
        self.whole = if self.whole < self.stops.0 { self.stops.0 } else { self.stops.1 };
        self.fraction = 0.0;
        self.velocity = 0.0;
    }

    fn span_of(&self, ns: Ns) -> Span {
        let substeps = ns.div_ceil(SUBSTEP_MAX_NS) as u32;
        let seconds = ns as f64 / 1e9;
        let substep_s = seconds / f64::from(substeps);
        Span {
            ns,
            substeps,
            substep_s,
            share: 1.0 / f64::from(substeps),
            rate: 1.0 / seconds,
            gain: self.velocity_gain * substep_s,
            gain_wanted: (self.velocity_gain + self.viscous_rate) * substep_s,
            torque: self.torque_limit * self.acceleration * substep_s,
            friction: self.dry_friction * self.acceleration * substep_s,
            friction_wanted: self.dry_friction * self.acceleration * substep_s / FRICTION_FADE,
            // A blocked shaft has no speed, so nothing of the speed remains after a sub-step.
            decay: if self.jammed { 0.0 } else { 1.0 / (1.0 + self.viscous_rate * substep_s) },
            torque_per_change: 1.0 / (self.acceleration * substep_s),
        }
    }

    fn coast(&mut self, span: &Span) {
        self.limited = false;
        self.torque = 0.0;
        for _ in 0..span.substeps {
            if self.velocity == 0.0 {
                return;
            }
            self.substep(span, 0.0);
        }
    }

    fn follow_position(&mut self, span: &Span, Way { start, by }: Way) {
        let feed_forward = by * span.rate;
        let step = by * span.share;
        let mut demand = start;
        let (mut wanted, mut asked) = (0.0, 0.0);
        for _ in 0..span.substeps {
            wanted = feed_forward + self.position_gain * (demand - self.fraction);
            asked = self.change_for(span, clamp_to(wanted, self.velocity_limit));
            if by == 0.0 && self.velocity == 0.0 && clamp_to(asked, span.friction) == asked {
                // The setpoint and the shaft are at standstill, and the demanded torque is below dry friction: friction
                // holds the shaft. Nothing changes in the following sub-steps, so friction holds the shaft in all of
                // them.
                break;
            }
            self.substep(span, clamp_to(asked, span.torque));
            demand += step;
        }
        self.finish_span((span.torque, span.torque_per_change), asked, clamp_to(wanted, self.velocity_limit) != wanted);
    }

    fn follow_velocity(&mut self, span: &Span, from: f64, to: f64) {
        let step = (to - from) * span.share;
        let mut wanted = from;
        let mut asked = 0.0;
        for _ in 0..span.substeps {
            wanted += step;
            asked = self.change_for(span, clamp_to(wanted, self.velocity_limit));
            self.substep(span, clamp_to(asked, span.torque));
        }
        self.finish_span((span.torque, span.torque_per_change), asked, clamp_to(wanted, self.velocity_limit) != wanted);
    }

    fn follow_torque(&mut self, span: &Span, torque: f64) {
        let target = torque / span.torque_per_change;
        let mut asked = 0.0;
        let mut too_fast = false;
        for _ in 0..span.substeps {
            let highest = self.change_for(span, self.velocity_limit);
            let lowest = self.change_for(span, -self.velocity_limit);
            asked = at_least(at_most(target, highest), lowest);
            too_fast = asked != target;
            self.substep(span, clamp_to(asked, span.torque));
        }
        self.finish_span((span.torque, span.torque_per_change), asked, too_fast);
    }

    /// The change of speed that the velocity loop demands in a sub-step, counts/s, including the compensation of
    /// friction.
    fn change_for(&self, span: &Span, wanted: f64) -> f64 {
        let dry = clamp_to(span.friction_wanted * wanted, span.friction);
        (span.gain_wanted * wanted - span.gain * self.velocity) + dry
    }

    /// Runs one sub-step: the motor changes the speed, friction reduces it, and the shaft moves.
    #[inline(always)]
    fn substep(&mut self, span: &Span, change: f64) {
        let driven = self.velocity + change;
        self.velocity = (driven - clamp_to(driven, span.friction)) * span.decay;
        self.fraction += self.velocity * span.substep_s;
    }

    /// Stores the torque of the last sub-step, and whether torque or speed was limited. `asked` is the change of speed that the
    /// velocity loop has demanded; `change_max` and `torque_per_change` are constants of the period, see [`Span`].
    #[inline]
    fn finish_span(&mut self, (change_max, torque_per_change): (f64, f64), asked: f64, speed_limited: bool) {
        let given = clamp_to(asked, change_max);
        self.torque = given * torque_per_change;
        self.limited = speed_limited || given != asked;
    }
}
