//! How an axis moves its plant: after the targets of CSP, CSV and CST, and to a stop on a ramp.

use super::{Axis, Demand, FOLLOWING_ERROR, FollowingWindow, Motion, NO_FOLLOWING_WINDOW};
use crate::ethercat::Ns;
use crate::slave::plant::Effort;
use crate::slave::state_machine::{DeviceFault, Ramp};

/// \[OURS] Bit 10 in CST: the torque is that near to its target, as a part of the rated one.
const TORQUE_REACHED: f64 = 0.01;

impl Axis {
    pub(super) fn follow_position(&mut self, ns: Ns, left: Ns) {
        let effort = self.demand_position(ns, left);
        self.plant.run(effort, ns);
        self.followed_position(ns);
    }

    /// The demand moves to the target, or as far as it comes in `ns` out of `left`. What the plant has to do for it.
    pub(super) fn demand_position(&mut self, ns: Ns, left: Ns) -> Effort {
        let demand = self.demand.whole.wrapping_add(self.origin);
        let way = self.targets.position.wrapping_sub(demand as i32);
        let wanted = demand.wrapping_add(way.into());
        let allowed = self.limits.map_or(wanted, |(low, high)| wanted.clamp(low, high));
        self.held_back = allowed != wanted;
        let target = allowed.wrapping_sub(self.origin);
        let Demand { whole, fraction, .. } = self.demand;
        let remaining = target.wrapping_sub(whole) as f64 - fraction;
        let by = if ns == left { remaining } else { remaining * (ns as f64 / left as f64) };
        if ns == left {
            (self.demand.whole, self.demand.fraction) = (target, 0.0);
        } else {
            self.move_demand(by);
        }
        self.reached = remaining == 0.0;
        Effort::Position { from: whole, fraction, by }
    }

    /// The plant has done that.
    pub(super) fn followed_position(&mut self, ns: Ns) {
        self.reached &= self.following_error().unsigned_abs() <= self.position_reached.unsigned_abs();
        self.watch_following_error(ns);
    }

    pub(super) fn move_demand(&mut self, by: f64) {
        let moved = self.demand.fraction + by;
        self.demand.whole = self.demand.whole.wrapping_add(moved as i64);
        self.demand.fraction = moved - (moved as i64) as f64;
    }

    /// CiA 402-2: outside the window for longer than the timeout is a fault. 0x6066 = 0: at once.
    pub(super) fn watch_following_error(&mut self, ns: Ns) {
        let FollowingWindow { counts, timeout_ms } = self.following;
        let outside = self.following_error().unsigned_abs() > counts.into();
        if !outside || counts == NO_FOLLOWING_WINDOW {
            self.outside_ns = 0;
            return;
        }
        self.outside_ns += ns;
        if self.outside_ns > Ns::from(timeout_ms) * 1_000_000 {
            self.machine.raise(DeviceFault { code: FOLLOWING_ERROR, resettable: true });
        }
    }

    pub(super) fn follow_velocity(&mut self, ns: Ns, left: Ns) {
        let target = f64::from(self.targets.velocity);
        let from = self.demand.velocity;
        let to = if ns == left { target } else { from + (target - from) * (ns as f64 / left as f64) };
        self.plant.run(Effort::Velocity { from, to }, ns);
        self.demand_here();
        self.demand.velocity = to;
        self.reached = (target - self.plant.velocity()).abs() <= self.velocity_reached;
    }

    pub(super) fn follow_torque(&mut self, ns: Ns) {
        let target = f64::from(self.targets.torque) / 1000.0;
        self.plant.run(Effort::Torque(target), ns);
        self.demand_here();
        self.reached = (target - self.plant.torque()).abs() <= TORQUE_REACHED;
    }

    pub(super) fn brake(&mut self, ramp: Ramp, ns: Ns) {
        if self.motion == Motion::Hold {
            let Demand { whole, fraction, .. } = self.demand;
            return self.plant.run(Effort::Position { from: whole, fraction, by: 0.0 }, ns);
        }
        if self.motion != Motion::Brake {
            self.motion = Motion::Brake;
            self.demand_here();
        }
        let deceleration = match ramp {
            Ramp::SlowDown => f64::from(self.settings.slow_down),
            Ramp::QuickStop => f64::from(self.settings.quick_stop),
            Ramp::TorqueLimit => self.plant.torque_as_acceleration(),
        };
        let from = self.demand.velocity;
        let cut = deceleration * (ns as f64 / 1e9);
        let to = if from > cut {
            from - cut
        } else if from < -cut {
            from + cut
        } else {
            0.0
        };
        self.plant.run(Effort::Velocity { from, to }, ns);
        self.demand_here();
        self.demand.velocity = to;
        if to == 0.0 && self.plant.is_at_standstill() {
            self.motion = Motion::Hold;
        }
    }
}
