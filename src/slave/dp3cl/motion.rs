//! The motion of the axis in each mode of operation. This file computes a position demand slice by slice; the axis
//! follows it.
//!
//! The axis model performs homing by itself. In every other mode it follows the position that this file gives it: in
//! CSP the target position of the process data, in the profile modes the position of [`Profile`]. Positions here are
//! command units of the shaft; the polarity, 0x607E, is applied when objects are read and written.

use super::alarms::Dp3clAlarm;
use super::objects::{self, Limits};
use super::profile::{Profile, Ramps};
use super::set_points::{SetPointValues, SetPoints};
use super::{Dp3cl, Dp3clMode};
use crate::ethercat::Ns;
use crate::ethercat::cia402::{Controlword, DriveState, Mode, Statusword};
use crate::slave::device::Model;
use crate::slave::state_machine::Power;
use crate::slave::switches::Input;

/// \[OURS] The interval at which the demand of the profile modes is computed, ns.
const SLICE_NS: Ns = 1_000_000;

/// Measures for how long a condition has been true without a break, ns. Used for position and speed windows.
#[derive(Clone, Copy, Debug, Default)]
struct Stopwatch(Ns);

impl Stopwatch {
    /// Advances by `ns` with the present value of the condition. Returns whether it has been true for longer than `ms`
    /// milliseconds.
    fn longer_than(&mut self, is_so: bool, ms: u16, ns: Ns) -> bool {
        self.0 = if is_so { self.0.saturating_add(ns) } else { 0 };
        is_so && self.0 > Ns::from(ms) * 1_000_000
    }
}

/// The state of the modes of operation: the requested and the active mode, the targets, and the position demand.
#[derive(Clone, Debug)]
pub(super) struct Motion {
    /// The mode that was written to 0x6060.
    pub(super) requested: i8,
    /// The active mode, 0x6061.
    pub(super) active: Dp3clMode,
    /// The target position as written to 0x607A.
    pub(super) target_position: i32,
    /// Whether a target position has come since CSP was entered.
    pub(super) target_came: bool,
    /// The target velocity as written to 0x60FF.
    pub(super) target_velocity: i32,
    profile: Profile,
    set_points: SetPoints,
    /// Whether a limit switch or a software limit restricts the motion: statusword bit 11, internal limit active.
    limited: bool,
    /// Whether the demand brakes on the quick-stop ramp in this slice. If so, the velocity in `profile` is already
    /// right and is not calculated from the motion of the axis.
    brakes: bool,
    was_enabled: bool,
    outside: Stopwatch,
    inside: Stopwatch,
    slow: Stopwatch,
    /// Statusword bits 10 to 13, which depend on the mode.
    bits: u16,
}

impl Motion {
    /// The state at power-on.
    pub(super) fn new() -> Self {
        Self {
            requested: 0,
            active: Dp3clMode::None,
            target_position: 0,
            target_came: false,
            target_velocity: 0,
            profile: Profile::default(),
            set_points: SetPoints::default(),
            limited: false,
            brakes: false,
            was_enabled: false,
            outside: Stopwatch::default(),
            inside: Stopwatch::default(),
            slow: Stopwatch::default(),
            bits: 0,
        }
    }

    /// The velocity of the demand, command units/s.
    pub(super) const fn velocity(&self) -> f64 {
        self.profile.velocity()
    }

    /// Statusword bits 10 to 13, whose meaning depends on the mode of operation.
    pub(super) const fn bits(&self) -> u16 {
        self.bits
    }
}

impl Dp3cl {
    /// Advances the modes of operation by `dt_ns`.
    pub(super) fn run_modes(&mut self, dt_ns: Ns) {
        self.motion.limited = false;
        let mut left = dt_ns;
        while left > 0 {
            let is_profile = matches!(self.motion.active, Dp3clMode::ProfilePosition | Dp3clMode::ProfileVelocity)
                || self.motion.active.code() != self.motion.requested;
            let ns = if is_profile && left >= 2 * SLICE_NS { SLICE_NS } else { left };
            self.run_slice(ns);
            left -= ns;
        }
        self.supervise(dt_ns);
    }

    /// Whether the modes of operation control the axis: the axis has power and does not brake on its own.
    pub(super) fn is_in_control(&self) -> bool {
        self.axis.follows() && self.axis.machine().power() == Power::Follow
    }

    fn run_slice(&mut self, ns: Ns) {
        let in_control = self.is_in_control();
        self.motion.brakes = false;
        let next_mode = Dp3clMode::from_code(self.motion.requested).filter(|mode| *mode != self.motion.active);
        match next_mode {
            None if in_control => self.move_demand(ns),
            None => self.stand_by(),
            Some(_) if in_control && !self.stands_for_change() => self.brake_for_change(ns),
            Some(mode) => {
                self.stand_by();
                self.enter_mode(mode);
            }
        }
        let before = self.axis.demand();
        self.axis.step(ns);
        let moves_by_axis = matches!(self.motion.active, Dp3clMode::CyclicPosition | Dp3clMode::Homing);
        if moves_by_axis && self.axis.follows() && !self.motion.brakes {
            let moved = self.axis.demand().wrapping_sub(before) as f64;
            let homed = self.motion.active == Dp3clMode::Homing;
            let velocity = if homed { self.axis.plant().velocity() } else { moved / (ns as f64 / 1e9) };
            self.motion.profile = Profile::moving_at(self.axis.demand(), velocity);
        }
        self.check_mode();
    }

    /// Discards targets and set-points, and sets the demand to the present demand of the axis. Called while the modes
    /// do not control the axis, and before a change of mode.
    fn stand_by(&mut self) {
        let position = self.axis.demand();
        let word = self.axis.machine().controlword().0;
        self.motion.profile = Profile::standing_at(position);
        self.motion.set_points.void(position, word);
        self.motion.target_came = false;
        self.axis.targets_mut().position = position as i32;
    }

    /// Whether the mode can change now, because the demand is at standstill. Homing mode can be left at any time, because
    /// the axis then brakes on its own.
    fn stands_for_change(&self) -> bool {
        self.motion.active == Dp3clMode::Homing || self.motion.profile.stands()
    }

    /// \[OURS] Brakes on the quick-stop ramp before a change of mode. The mode can be changed in any state of the
    /// drive. An unsupported value of 0x6060 leaves the active mode unchanged (E-881).
    fn brake_for_change(&mut self, ns: Ns) {
        let ramp = self.ramp(objects::QUICK_STOP);
        self.motion.profile.brake(ramp, ns);
        self.motion.brakes = true;
        self.put_demand();
    }

    fn enter_mode(&mut self, mode: Dp3clMode) {
        self.motion.active = mode;
        self.axis.set_mode(if mode == Dp3clMode::Homing { Mode::Homing } else { Mode::Csp });
        (self.motion.inside, self.motion.slow) = Default::default();
    }

    /// Moves the demand for `ns` according to the active mode.
    fn move_demand(&mut self, ns: Ns) {
        match self.motion.active {
            Dp3clMode::Homing => return,
            Dp3clMode::CyclicPosition => self.follow_process_data(ns),
            Dp3clMode::ProfilePosition => self.run_profile_position(ns),
            Dp3clMode::ProfileVelocity => self.run_profile_velocity(ns),
            Dp3clMode::None => {
                let ramp = self.ramp(objects::QUICK_STOP);
                self.motion.profile.brake(ramp, ns);
            }
        }
        self.put_demand();
    }

    fn put_demand(&mut self) {
        self.axis.targets_mut().position = self.motion.profile.position() as i32;
    }

    /// CSP: moves the demand to the target position plus the position offset, 0x60B0.
    fn follow_process_data(&mut self, ns: Ns) {
        let demand = self.axis.demand();
        if !self.motion.target_came {
            self.motion.profile = Profile::standing_at(demand);
            return;
        }
        let offset = self.base().values.get(objects::POSITION_OFFSET);
        let target = self.shaft_position(self.motion.target_position.wrapping_add(offset));
        // `target` has only 32 bits. It means the position with these low 32 bits that is nearest to the demand.
        let wanted = demand.wrapping_add(target.wrapping_sub(demand as i32).into());
        let allowed = self.within_limits(wanted);
        let way = allowed.wrapping_sub(demand);
        if !self.is_blocked(way as f64) {
            self.motion.profile = Profile::standing_at(allowed);
            return;
        }
        let ramp = self.ramp(objects::QUICK_STOP);
        let profile = &mut self.motion.profile;
        profile.brake(ramp, ns);
        let beyond = profile.position().wrapping_sub(allowed);
        if beyond.signum() == way.signum() {
            // If the braking demand has passed the target, it is set to the target and keeps the velocity of the ramp.
            // Otherwise the next slice would move the demand back to the target in one step.
            *profile = Profile::moving_at(allowed, profile.velocity());
        }
        self.motion.brakes = true;
    }

    fn run_profile_position(&mut self, ns: Ns) {
        let word = self.axis.machine().controlword().0;
        let values = SetPointValues { target: self.shaft_target(), ramps: self.position_ramps() };
        self.motion.set_points.command(word, values, self.config.variants.one_deep_buffer);
        let current = self.motion.set_points.current().copied();
        let halts = word & Controlword::HALT != 0;
        let Some(task) = current.filter(|_| !halts) else {
            let ramp = if halts { self.halt_ramp() } else { values.ramps.deceleration };
            self.motion.profile.brake(ramp, ns);
            return;
        };
        let target = self.within_limits(task.target);
        let way = target.wrapping_sub(self.motion.profile.position()) as f64;
        if self.is_blocked(if self.motion.profile.stands() { way } else { self.motion.profile.velocity() }) {
            let ramp = self.ramp(objects::QUICK_STOP);
            if self.motion.profile.brake(ramp, ns) {
                self.motion.set_points.stop_short(self.motion.profile.position());
            }
        } else if self.motion.profile.run_to(target, &task.ramps, ns) {
            self.motion.set_points.arrive();
        }
    }

    fn run_profile_velocity(&mut self, ns: Ns) {
        let word = self.axis.machine().controlword().0;
        if word & Controlword::HALT != 0 {
            let ramp = self.halt_ramp();
            self.motion.profile.brake(ramp, ns);
            return;
        }
        let (wanted, ramps) = (self.wanted_velocity(), self.position_ramps());
        let moving = self.motion.profile.velocity();
        if self.is_blocked(wanted) || self.is_blocked(moving) {
            let ramp = self.ramp(objects::QUICK_STOP);
            self.motion.profile.brake(ramp, ns);
        } else {
            self.motion.profile.run_at(wanted, &ramps, ns);
        }
    }

    /// The velocity that 0x60FF requests, command units/s of the shaft, limited by 0x607F and 0x6080.
    fn wanted_velocity(&self) -> f64 {
        let wanted = self.units_per_second(self.motion.target_velocity) * self.velocity_sign();
        let most = self.velocity_max();
        wanted.clamp(-most, most)
    }

    /// Converts a speed of an object into command units/s. \[OURS] 0x60FF, 0x606B, 0x606D and 0x606F are in 0.1 rpm, as the
    /// manual says of 0x60FF, unless the variant `speeds_in_units` is on.
    fn units_per_second(&self, speed: i32) -> f64 {
        if self.config.variants.speeds_in_units {
            return f64::from(speed);
        }
        f64::from(speed) * f64::from(self.memory.subdivision()) / 600.0
    }

    /// Converts command units/s into the unit of speed objects: the inverse of [`Self::units_per_second`].
    pub(super) fn as_speed(&self, units_per_second: f64) -> f64 {
        if self.config.variants.speeds_in_units {
            return units_per_second;
        }
        units_per_second * 600.0 / f64::from(self.memory.subdivision())
    }

    /// The lower of the limits 0x607F and 0x6080, command units/s.
    fn velocity_max(&self) -> f64 {
        let values = &self.base().values;
        let by_profile = f64::from(values.get(objects::MAX_PROFILE_VELOCITY));
        let by_motor = f64::from(values.get(objects::MAX_MOTOR_SPEED)) * f64::from(self.memory.subdivision()) / 60.0;
        by_profile.min(by_motor)
    }

    /// The speed of profile position mode, 0x6081 (command units/s), and the ramps of both profile modes, 0x6083 and
    /// 0x6084 (command units/s²), limited by 0x607F, 0x6080, 0x60C5 and 0x60C6.
    fn position_ramps(&self) -> Ramps {
        let values = &self.base().values;
        let within = |ramp, most| self.ramp(ramp).min(self.ramp(most));
        Ramps {
            velocity: f64::from(values.get(objects::PROFILE_VELOCITY)).min(self.velocity_max()),
            acceleration: within(objects::PROFILE_ACCELERATION, objects::MAX_ACCELERATION),
            deceleration: within(objects::PROFILE_DECELERATION, objects::MAX_DECELERATION),
        }
    }

    /// The ramp of a halt, selected by the halt option code 0x605D.
    fn halt_ramp(&self) -> f64 {
        match self.base().values.get(objects::HALT_OPTION) {
            1 => self.position_ramps().deceleration,
            _ => self.ramp(objects::QUICK_STOP),
        }
    }

    /// Limits a target to the position range 0x607B and the software limits 0x607D. \[OURS] A pair whose minimum is not
    /// less than its maximum has no effect.
    fn within_limits(&mut self, wanted: i64) -> i64 {
        let mut allowed = wanted;
        for Limits { min, max } in [objects::POSITION_RANGE, objects::SOFTWARE_LIMITS] {
            let values = &self.base().values;
            let (min, max) = (values.get(min), values.get(max));
            if min < max {
                let ends = [self.shaft_position(min), self.shaft_position(max)].map(i64::from);
                let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
                allowed = allowed.clamp(low, high);
            }
        }
        self.motion.limited |= allowed != wanted;
        allowed
    }

    /// Whether the limit switch in the direction of motion (the sign of `direction`) is active. \[OURS] It stops the axis
    /// on the quick-stop ramp.
    fn is_blocked(&mut self, direction: f64) -> bool {
        let inputs = self.axis.inputs();
        let blocked =
            direction > 0.0 && inputs.has(Input::PositiveLimit) || direction < 0.0 && inputs.has(Input::NegativeLimit);
        self.motion.limited |= blocked;
        blocked
    }

    /// Raises E-881 if the drive is enabled without a mode or in an unsupported one.
    fn check_mode(&mut self) {
        let is_enabled = self.axis.machine().state() == DriveState::OperationEnabled;
        let was_enabled = std::mem::replace(&mut self.motion.was_enabled, is_enabled);
        let requested = Dp3clMode::from_code(self.motion.requested);
        let without_mode = requested == Some(Dp3clMode::None) && self.motion.active == Dp3clMode::None;
        if is_enabled && (requested.is_none() || without_mode && !was_enabled) {
            self.raise(Dp3clAlarm::Mode);
        }
    }

    /// Compares demand and actual values with their windows, and sets statusword bits 10 to 13.
    fn supervise(&mut self, dt_ns: Ns) {
        let values = &self.base().values;
        let lag = self.following_error().unsigned_abs();
        let (window, timeout) = (values.get(objects::FOLLOWING_WINDOW), values.get(objects::FOLLOWING_TIMEOUT));
        let (near, near_ms) = (values.get(objects::POSITION_WINDOW), values.get(objects::POSITION_WINDOW_TIME));
        let (fast, fast_ms) = (values.get(objects::VELOCITY_WINDOW), values.get(objects::VELOCITY_WINDOW_TIME));
        let (still, still_ms) = (values.get(objects::VELOCITY_THRESHOLD), values.get(objects::VELOCITY_THRESHOLD_TIME));
        let follows = self.axis.follows() && self.axis.machine().state() == DriveState::OperationEnabled;
        let halts = self.axis.machine().controlword().0 & Controlword::HALT != 0;
        let (wanted, velocity) = (self.wanted_velocity(), self.motion.profile.velocity());
        let (deviation, speed) = (self.as_speed(wanted - velocity).abs(), self.as_speed(velocity).abs());
        let stands = self.motion.profile.stands();
        let motion = &mut self.motion;
        let has_window = window != u32::MAX;
        let lags = motion.outside.longer_than(follows && has_window && lag > window.into(), timeout, dt_ns);
        let following_error = if lags { Statusword::BIT13 } else { 0 };
        let limit = if motion.limited { Statusword::INTERNAL_LIMIT } else { 0 };
        motion.bits = match motion.active {
            Dp3clMode::Homing => self.axis.measured().statusword.0 & 0x3C00,
            _ if !follows => 0,
            Dp3clMode::None => 0,
            Dp3clMode::CyclicPosition => Statusword::BIT12 | following_error | limit,
            Dp3clMode::ProfilePosition => {
                let is_near = motion.set_points.are_complete() && lag <= near.into();
                let is_there = motion.inside.longer_than(is_near, near_ms, dt_ns);
                let reached = if halts { stands } else { is_there };
                let acknowledged = if motion.set_points.is_acknowledged() { Statusword::BIT12 } else { 0 };
                bit(reached, Statusword::TARGET_REACHED) | acknowledged | following_error | limit
            }
            Dp3clMode::ProfileVelocity => {
                let is_fast = motion.inside.longer_than(deviation <= f64::from(fast), fast_ms, dt_ns);
                let is_slow = motion.slow.longer_than(speed <= f64::from(still), still_ms, dt_ns);
                let reached = if halts { stands } else { is_fast };
                bit(reached, Statusword::TARGET_REACHED) | bit(is_slow, Statusword::BIT12) | limit
            }
        };
    }
}

const fn bit(is_set: bool, bit: u16) -> u16 {
    if is_set { bit } else { 0 }
}
