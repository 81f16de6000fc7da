//! The motion of an axis during homing: the velocity that a homing run asks for becomes a position demand, and the position
//! where home was found becomes the origin of the position actual value. The homing methods are in
//! [`homing`](crate::slave::homing).
//!
//! **The axis does not jump.** The counts of the shaft never change. Attaining home changes [`Axis::origin`], which 0x6064,
//! 0x6062 and 0x607A add to these counts. A target position that the master computed before it could see the new positions
//! would make the axis jump in the next mode. So the axis ignores target positions \[OURS] while the mode is 6, while it
//! still brakes after the mode was left, and in the first exchange after home was attained or after such braking has ended.
//! Meanwhile it holds its position. When the master sends the target position of the following exchange, it has already
//! seen the new actual position, so the axis follows that target again.

use super::measure::rounded;
use super::{Axis, Demand, Motion};
use crate::ethercat::Ns;
use crate::ethercat::cia402::Mode;
use crate::slave::homing::{HomePosition, Homing, Shaft};
use crate::slave::plant::Setpoint;
use crate::slave::switches::{Input, Inputs};

/// The minimum time without motion that counts as standstill, ns. A shorter time could be the momentary standstill of a
/// reversing shaft \[OURS].
const STANDSTILL_NS: Ns = 5_000_000;

impl Axis {
    /// The state machine of homing mode: the present homing run, and the error that ended the last one.
    pub const fn homing(&self) -> &Homing {
        &self.homing
    }

    /// Position actual value (0x6064), counts: the shaft's position plus the origin that homing has set.
    pub const fn position(&self) -> i64 {
        self.plant.position().wrapping_add(self.origin)
    }

    /// The position actual value at which the shaft's count is 0.
    pub const fn origin(&self) -> i64 {
        self.origin
    }

    /// The states of the switches at the present position of the shaft, bits 0 to 2 of 0x60FD.
    pub fn inputs(&self) -> Inputs {
        self.switches.read(self.plant.position())
    }

    /// Makes a switch stick at a value; `None` repairs it.
    pub const fn stick(&mut self, input: Input, value: Option<bool>) {
        self.switches.stick(input, value);
    }

    /// Blocks the shaft mechanically, or frees it.
    pub const fn jam(&mut self, jammed: bool) {
        self.plant.jam(jammed);
    }

    /// Takes over the target position from process data. The first target position after homing is discarded: the
    /// master computed it before it could see the position that homing has set, and the axis would jump.
    pub const fn take_target_position(&mut self, position: i32) {
        if self.skip_next_target {
            self.skip_next_target = false;
        } else {
            self.targets.position = position;
        }
    }

    /// Advances homing mode by `ns` while the power stage follows the demand.
    pub(super) fn step_homing(&mut self, ns: Ns) {
        let from = self.plant.position();
        let moves = self.demand.velocity != 0.0 || self.plant.velocity().abs() > self.velocity_reached;
        let shaft = Shaft { position: from, moves };
        let word = self.machine.controlword();
        self.homing.command(word, shaft, &self.settings.homing, &self.switches);
        let Some((at, speed)) = self.homing.destination() else {
            let way = self.ramp_demand(self.homing.velocity(), self.homing_ramp(), ns);
            self.homing.pass(from, self.plant.position(), way, &self.switches);
            if self.homing.stays_beyond_home() {
                self.attain_home();
            }
            return;
        };
        if self.homing.stays_beyond_home() {
            self.ramp_demand(0.0, self.homing_ramp(), ns);
            return self.attain_home();
        }
        self.run_to(at, speed, ns);
        let has_arrived = self.demand.whole == at && self.plant.position() == at && self.is_standing_still();
        if has_arrived {
            self.attain_home();
        }
    }

    /// Ends the homing run with "homing attained" if home has been found.
    fn attain_home(&mut self) {
        if let Some(homed) = self.homing.arrive() {
            self.set_origin_at_home(homed);
        }
    }

    /// Called in homing mode when the power stage begins to follow the demand: adds the shaft's fraction of a count to
    /// the demand. The demand is then exactly the position of the shaft, and the shaft does not move.
    pub(super) const fn hold_for_homing(&mut self) {
        self.demand.fraction = self.plant.fraction();
    }

    /// Ends a homing run, because the power stage no longer follows the demand.
    pub(super) fn stop_homing_unpowered(&mut self) {
        if self.mode == Mode::Homing {
            self.homing.lose_power(self.machine.controlword());
        }
    }

    /// Brakes the axis for `ns` after homing mode was left during a motion. Returns false if the axis is already at
    /// standstill: then it has not moved, and the caller runs the new mode for these `ns`.
    pub(super) fn brake_after_homing(&mut self, ns: Ns) -> bool {
        if self.is_standing_still() {
            self.hold_target();
            self.skip_next_target = true;
            return false;
        }
        let ramp = self.settings.homing_exit.map_or(self.homing.acceleration(), f64::from);
        self.ramp_demand(0.0, ramp, ns);
        true
    }

    /// Whether shaft and demand have been at standstill for [`STANDSTILL_NS`].
    pub(super) const fn is_standing_still(&self) -> bool {
        self.standstill_ns >= STANDSTILL_NS
    }

    /// Starts measuring the standstill when homing mode begins. An axis that does not move counts as at standstill at
    /// once, without waiting for [`STANDSTILL_NS`].
    pub(super) fn reset_standstill(&mut self) {
        self.standstill_ns = if self.is_still() { STANDSTILL_NS } else { 0 };
    }

    /// Adds `ns` to the time of standstill, or resets this time if the shaft or the demand moves.
    pub(super) fn track_standstill(&mut self, ns: Ns) {
        self.standstill_ns = if self.is_still() { self.standstill_ns.saturating_add(ns) } else { 0 };
    }

    fn is_still(&self) -> bool {
        let demanded = matches!(self.motion, Motion::Follow | Motion::BrakeAfterHoming) && self.demand.velocity != 0.0;
        self.plant.is_at_standstill() && !demanded
    }

    /// The active ramp of homing, counts/s²: homing acceleration 0x609A, or during a halt the ramp that option code 0x605D
    /// selects.
    fn homing_ramp(&self) -> f64 {
        match self.homing.halt_option() {
            Some(2) => self.settings.quick_stop.into(),
            Some(3 | 4) => self.plant.torque_as_acceleration(),
            _ => self.homing.acceleration(),
        }
    }

    /// Moves the demand for `ns` towards the count `at`, with at most `speed` counts/s and the homing acceleration. The
    /// motion ends exactly at that count, without a fraction.
    fn run_to(&mut self, at: i64, speed: f64, ns: Ns) {
        let seconds = ns as f64 / 1e9;
        let ramp = self.homing.acceleration();
        let speed = speed.min(self.settings.max_velocity.into());
        let Demand { whole, fraction, velocity: from } = self.demand;
        let left = at.wrapping_sub(whole) as f64 - fraction;
        let most = ramp * seconds;
        // The remaining distance is so short that it is covered within this time without exceeding ramp or speed.
        if left.abs() <= (most * seconds).min(speed * seconds) && from.abs() <= most {
            self.plant.run(Setpoint::Position { from: whole, fraction, by: left }, ns);
            self.demand = Demand { whole: at, fraction: 0.0, velocity: 0.0 };
            return self.monitor_following_error(ns);
        }
        // The maximum velocity at the end of this time from which the ramp still stops at the count: the `end` that
        // solves end² / (2 ramp) + (now + end) seconds / 2 = way.
        let towards = if left < 0.0 { -1.0 } else { 1.0 };
        let (way, now) = (left * towards, from * towards);
        let root = seconds * seconds * 0.25 + 2.0 / ramp * (way - now * seconds * 0.5);
        let wanted = if root > 0.0 { ramp * (root.sqrt() - seconds * 0.5) } else { 0.0 };
        self.ramp_demand(wanted.clamp(0.0, speed) * towards, ramp, ns);
    }

    /// Moves the demand for `ns` while its velocity changes towards `wanted`, counts/s, by at most `ramp`, counts/s².
    /// Returns the distance, counts.
    fn ramp_demand(&mut self, wanted: f64, ramp: f64, ns: Ns) -> f64 {
        let seconds = ns as f64 / 1e9;
        let limit = f64::from(self.settings.max_velocity);
        let Demand { whole, fraction, velocity: from } = self.demand;
        let most = ramp * seconds;
        let to = wanted.clamp(-limit, limit).clamp(from - most, from + most);
        let by = (from + to) * 0.5 * seconds;
        self.plant.run(Setpoint::Position { from: whole, fraction, by }, ns);
        self.move_demand(by);
        // The demand is rounded to the nearest count, as the position of the shaft is. So both are the same count at
        // standstill.
        let counts = rounded(self.demand.fraction);
        self.demand.whole = self.demand.whole.wrapping_add(counts);
        self.demand.fraction -= counts as f64;
        self.demand.velocity = to;
        self.monitor_following_error(ns);
        by
    }

    /// Sets the origin so that the position actual value at home is the home offset.
    fn set_origin_at_home(&mut self, HomePosition { at, offset }: HomePosition) {
        self.origin = i64::from(offset).wrapping_sub(at);
        self.skip_next_target = true;
    }
}
