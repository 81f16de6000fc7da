//! The cyclic modes of an axis: following the targets of CSP, CSV and CST, braking on a ramp, and stopping at limit
//! switches that act in these modes.

use super::{Axis, Demand, Motion};
use crate::ethercat::Ns;
use crate::slave::plant::Setpoint;
use crate::slave::state_machine::Ramp;
use crate::slave::switches::Input;

/// \[OURS] In CST statusword bit 10, target reached, is set while the actual torque differs from the target by at most
/// this fraction of the rated torque.
const TORQUE_REACHED: f64 = 0.01;

impl Axis {
    /// CSP: advances the plant by `ns`, a part of the cycle. The demand moves evenly, so that it reaches the target
    /// position after `left` ns, at the end of the cycle.
    pub(super) fn follow_position(&mut self, ns: Ns, left: Ns) {
        let setpoint = self.demand_position(ns, left);
        self.plant.run(setpoint, ns);
        self.followed_position(ns);
    }

    /// Moves the demand for `ns` towards the target, at the rate that reaches the target in `left` ns. Returns the setpoint
    /// for the plant.
    pub(super) fn demand_position(&mut self, ns: Ns, left: Ns) -> Setpoint {
        let demand = self.demand();
        let offset = if self.targets.has_offsets { self.offsets.position } else { 0 };
        let way = self.targets.position.wrapping_add(offset).wrapping_sub(demand as i32);
        let wanted = demand.wrapping_add(way.into());
        let allowed = self.limits.map_or(wanted, |(low, high)| wanted.clamp(low, high));
        self.position_limited = allowed != wanted;
        let target = allowed.wrapping_sub(self.origin);
        let Demand { whole, fraction, .. } = self.demand;
        let remaining = target.wrapping_sub(whole) as f64 - fraction;
        let by = if ns == left { remaining } else { remaining * (ns as f64 / left as f64) };
        if self.limits_stop_motion && self.is_at_switch(remaining) {
            let by = self.brake_at_switch(by, ns);
            self.move_demand(by);
            (self.position_limited, self.target_reached) = (true, false);
            return Setpoint::Position { from: whole, fraction, by };
        }
        self.held_by_switch = false;
        if ns == left {
            (self.demand.whole, self.demand.fraction) = (target, 0.0);
        } else {
            self.move_demand(by);
        }
        self.target_reached = remaining == 0.0;
        Setpoint::Position { from: whole, fraction, by }
    }

    /// Whether the limit switch in the direction of motion (the sign of `direction`) is active.
    fn is_at_switch(&self, direction: f64) -> bool {
        let inputs = self.inputs();
        direction > 0.0 && inputs.has(Input::PositiveLimit) || direction < 0.0 && inputs.has(Input::NegativeLimit)
    }

    /// CSP at an active limit switch: brakes the demand to a standstill on the quick-stop ramp. Returns the distance
    /// that the demand moves in `ns`, counts: at most the `wanted` distance to the target.
    fn brake_at_switch(&mut self, wanted: f64, ns: Ns) -> f64 {
        if !self.held_by_switch {
            self.held_by_switch = true;
            self.demand.velocity = self.plant.velocity();
        }
        let towards = if wanted < 0.0 { -1.0 } else { 1.0 };
        let from = (self.demand.velocity * towards).max(0.0);
        let to = slower(from, f64::from(self.settings.quick_stop), ns);
        self.demand.velocity = to * towards;
        ((from + to) * 0.5 * (ns as f64 / 1e9)).min(wanted.abs()) * towards
    }

    /// CSV and CST at an active limit switch: brakes the axis for `ns` on the quick-stop ramp.
    fn stop_at_switch(&mut self, ns: Ns) {
        let from = self.demand.velocity;
        let to = slower(from, f64::from(self.settings.quick_stop), ns);
        self.run_velocity(from, to, ns);
        self.position_limited = true;
    }

    /// Updates statusword bit 10 (target reached) and monitors the following error, after the plant has followed a
    /// position setpoint for `ns`.
    pub(super) fn followed_position(&mut self, ns: Ns) {
        self.target_reached &= self.following_error().unsigned_abs() <= self.position_reached.unsigned_abs();
        self.monitor_following_error(ns);
    }

    pub(super) fn move_demand(&mut self, by: f64) {
        let moved = self.demand.fraction + by;
        self.demand.whole = self.demand.whole.wrapping_add(moved as i64);
        self.demand.fraction = moved - (moved as i64) as f64;
    }

    /// CSV: advances the plant by `ns`, a part of the cycle. The velocity demand changes evenly, so that it reaches the
    /// target velocity after `left` ns, at the end of the cycle.
    pub(super) fn follow_velocity(&mut self, ns: Ns, left: Ns) {
        let target = f64::from(self.targets.velocity) + f64::from(self.offsets.velocity);
        if self.limits_stop_motion && self.is_at_switch(target) {
            return self.stop_at_switch(ns);
        }
        let from = self.demand.velocity;
        let to = if ns == left { target } else { from + (target - from) * (ns as f64 / left as f64) };
        self.run_velocity(from, to, ns);
        self.target_reached = (target - self.plant.velocity()).abs() <= self.velocity_reached;
    }

    /// CST: advances the plant by `ns` with the target torque.
    pub(super) fn follow_torque(&mut self, ns: Ns) {
        let target = (f64::from(self.targets.torque) + f64::from(self.offsets.torque)) / 1000.0;
        if self.limits_stop_motion && self.is_at_switch(target) {
            return self.stop_at_switch(ns);
        }
        self.plant.run(Setpoint::Torque(target), ns);
        self.set_demand_to_actual();
        self.target_reached = (target - self.plant.torque()).abs() <= TORQUE_REACHED;
    }

    /// Brakes the motor on `ramp` for `ns`, or holds it after it has stopped. Called while the state machine stops the
    /// motor.
    pub(super) fn brake(&mut self, ramp: Ramp, ns: Ns) {
        if self.motion == Motion::Hold {
            let Demand { whole, fraction, .. } = self.demand;
            return self.plant.run(Setpoint::Position { from: whole, fraction, by: 0.0 }, ns);
        }
        if self.motion != Motion::Brake {
            self.motion = Motion::Brake;
            self.set_demand_to_actual();
        }
        let deceleration = match ramp {
            Ramp::SlowDown => f64::from(self.settings.slow_down),
            Ramp::QuickStop => f64::from(self.settings.quick_stop),
            Ramp::TorqueLimit => self.plant.torque_as_acceleration(),
        };
        let from = self.demand.velocity;
        let to = slower(from, deceleration, ns);
        self.run_velocity(from, to, ns);
        if to == 0.0 && self.plant.is_at_standstill() {
            self.motion = Motion::Hold;
        }
    }

    /// Runs the plant for `ns` at a velocity that changes evenly between two values, counts/s. The position demand follows
    /// the shaft.
    fn run_velocity(&mut self, from: f64, to: f64, ns: Ns) {
        self.plant.run(Setpoint::Velocity { from, to }, ns);
        self.set_demand_to_actual();
        self.demand.velocity = to;
    }
}

/// The velocity after `ns` of braking on a ramp (counts/s²), in counts/s.
fn slower(from: f64, ramp: f64, ns: Ns) -> f64 {
    let cut = ramp * (ns as f64 / 1e9);
    if from > cut {
        from - cut
    } else if from < -cut {
        from + cut
    } else {
        0.0
    }
}
