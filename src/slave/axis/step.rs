//! The time step of an axis: a step is divided into slices, and in each slice the state machine determines what the power
//! stage does.

use super::{Axis, Demand, Motion};
use crate::ethercat::Ns;
use crate::ethercat::cia402::Mode;
use crate::slave::plant::{Plant, SUBSTEP_MAX_NS, Servo, Setpoint};
use crate::slave::state_machine::Power;

/// \[OURS] The approximate interval at which the state machine and the following error are evaluated, ns. A shorter cycle
/// evaluates them once.
const SLICE_NS: Ns = 1_000_000;
/// \[OURS] The same interval in homing mode, ns. It is shorter, so that a switch acts soon after the axis reaches it. The
/// position of the switch is exact to a count in any case.
const HOMING_SLICE_NS: Ns = 2 * SUBSTEP_MAX_NS;

impl Axis {
    /// Advances the axis by `dt_ns`. The demand reaches the targets at the end of this time.
    pub fn step(&mut self, dt_ns: Ns) {
        let slice =
            if self.mode == Mode::Homing { slice_of::<HOMING_SLICE_NS>(dt_ns) } else { slice_of::<SLICE_NS>(dt_ns) };
        let mut left = dt_ns;
        while left > 0 {
            let ns = if left < 2 * slice { left } else { slice };
            self.slice(ns, left);
            left -= ns;
        }
        self.measure();
    }

    /// The first half of [`Axis::step`]. If the axis follows its target in CSP and the step is one slice, this function
    /// returns the motor. The caller runs this motor together with the motors of other axes, which is faster, and then
    /// calls [`Axis::end_step`]. In all other cases this function does the whole step and returns `None`.
    pub fn begin_step(&mut self, dt_ns: Ns) -> Option<&mut Servo> {
        self.motor_handed_out = false;
        let one_slice = dt_ns > 0 && dt_ns < SLICE_NS + SLICE_NS / 2;
        let follows = self.motion == Motion::Follow && matches!(self.mode, Mode::Csp);
        if !one_slice || !follows || matches!(self.plant, Plant::Pulses(_)) {
            self.step(dt_ns);
            return None;
        }
        self.machine.step(dt_ns, self.has_stopped());
        if self.machine.power() != Power::Follow {
            self.run_power_stage(dt_ns, dt_ns);
            self.measure();
            return None;
        }
        self.motor_handed_out = true;
        let setpoint = self.demand_position(dt_ns, dt_ns);
        match (&mut self.plant, setpoint) {
            (Plant::Servo(servo), Setpoint::Position { from, fraction, by }) => {
                servo.aim_at(from, fraction, by);
                Some(servo)
            }
            _ => None,
        }
    }

    /// The second half of [`Axis::step`]. Call it after every [`Axis::begin_step`], even if that returned `None`.
    pub fn end_step(&mut self, dt_ns: Ns) {
        if std::mem::take(&mut self.motor_handed_out) {
            self.followed_position(dt_ns);
            self.measure();
        }
    }

    /// Advances the axis by one slice of `ns`. `left` is the time to the end of the cycle, ns, when the demand reaches the
    /// targets.
    fn slice(&mut self, ns: Ns, left: Ns) {
        self.machine.step(ns, self.has_stopped());
        self.run_power_stage(ns, left);
        if self.mode == Mode::Homing || self.motion == Motion::BrakeAfterHoming {
            self.track_standstill(ns);
        }
    }

    fn run_power_stage(&mut self, ns: Ns, left: Ns) {
        match self.machine.power() {
            Power::Off => {
                self.plant.run(Setpoint::Coast, ns);
                self.motion = Motion::Off;
                self.set_demand_to_actual();
                self.stop_homing_unpowered();
            }
            Power::Follow => {
                if self.motion != Motion::Follow {
                    if self.motion == Motion::BrakeAfterHoming && self.brake_after_homing(ns) {
                        return;
                    }
                    self.motion = Motion::Follow;
                    self.set_demand_to_actual();
                    if self.mode == Mode::Homing {
                        self.hold_for_homing();
                    }
                }
                match self.mode {
                    Mode::Csv => self.follow_velocity(ns, left),
                    Mode::Cst => self.follow_torque(ns),
                    Mode::Homing => self.step_homing(ns),
                    Mode::Csp => self.follow_position(ns, left),
                }
            }
            Power::Stop(ramp) => {
                self.brake(ramp, ns);
                self.stop_homing_unpowered();
            }
        }
    }

    /// Whether the motor counts as stopped for the state machine: it has braked and is held, or it has no power and the
    /// shaft is at standstill.
    fn has_stopped(&self) -> bool {
        match self.motion {
            Motion::Off => self.plant.is_at_standstill(),
            Motion::Hold => true,
            Motion::Follow | Motion::Brake | Motion::BrakeAfterHoming => false,
        }
    }

    /// Sets the demand to the actual position and velocity of the shaft.
    pub(super) fn set_demand_to_actual(&mut self) {
        self.demand = Demand { whole: self.plant.position(), fraction: 0.0, velocity: self.plant.velocity() };
        self.outside_ns = 0;
        self.target_reached = false;
        self.position_limited = false;
    }
}

/// The slice length for a step of `dt_ns`: all slices are equally long, and their length is as near to `USUAL` as possible.
const fn slice_of<const USUAL: Ns>(dt_ns: Ns) -> Ns {
    // The common cases (one slice, or two in homing) avoid a division, which would be a considerable part of a slice's
    // cost.
    match (dt_ns + USUAL / 2) / USUAL {
        0 | 1 => dt_ns,
        2 => dt_ns / 2,
        slices => dt_ns / slices,
    }
}
