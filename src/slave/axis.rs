//! One axis of a drive: state machine, plant, and between them the cyclic modes CSP, CSV and CST, and homing.
//!
//! A target is reached evenly over the time of the step that follows it: [`Axis::step`] is called once after each
//! exchange of process data, with the length of the cycle, and the demand moves from where it was to the new target
//! meanwhile. The axis thus lags its targets by one cycle, and needs no word on how long a cycle is.
//!
//! Positions are `i64` counts inside and wrap to the `i32` of objects 0x6064 and 0x607A: a target means the position
//! nearest to the present demand that has those low 32 bits, so an axis may turn in one direction for ever.

mod follow;
mod homing;

use super::homing::{Homing, HomingSettings};
use super::plant::{Effort, Following, Motor, Plant, PulseTrain, Pulses, SUBSTEP_MAX_NS, Servo, Shown};
use super::state_machine::{OptionCodes, Power, StateMachine, TransitionTimes};
use super::switches::{Switches, Travel};
use crate::cia402::{DriveState, Mode, Statusword};
use crate::ethercat::Ns;

/// Error code of a following error (CiA 402-2, 0x603F).
pub const FOLLOWING_ERROR: u16 = 0x8611;
/// Value of 0x6065 that switches the following error off (CiA 402-2).
pub const NO_FOLLOWING_WINDOW: u32 = u32::MAX;
/// \[OURS] The state machine and the following error are looked at about that often; short cycles: once a cycle.
const SLICE_NS: Ns = 1_000_000;
/// \[OURS] In homing that often, so that a switch acts soon after it is seen; where it was is known to the count all
/// the same.
const HOMING_SLICE_NS: Ns = 2 * SUBSTEP_MAX_NS;

/// What an axis reads of its drive's objects. Times in ms, the rest in counts, counts/s and counts/s².
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// 0x6065; [`NO_FOLLOWING_WINDOW`]: off.
    pub following_window: u32,
    /// 0x6066.
    pub following_timeout_ms: u16,
    /// 0x607D:1 and :2. \[OURS] Off unless the first is less than the second.
    pub position_limits: (i32, i32),
    /// 0x607F. \[OURS] It limits every mode.
    pub max_velocity: u32,
    /// 0x6072, 0.1 % of rated.
    pub max_torque: u16,
    /// 0x6084, the slow-down ramp.
    pub slow_down: u32,
    /// 0x6085, the quick-stop ramp.
    pub quick_stop: u32,
    /// 0x605A to 0x605E.
    pub options: OptionCodes,
    /// 0x607C, 0x6098 to 0x609A, 0x605D.
    pub homing: HomingSettings,
}

/// Targets of the cyclic modes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Targets {
    /// 0x607A, counts.
    pub position: i32,
    /// 0x60FF, counts/s.
    pub velocity: i32,
    /// 0x6071, 0.1 % of rated.
    pub torque: i16,
}

/// What an axis has measured at the end of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Measured {
    /// 0x6041.
    pub statusword: Statusword,
    /// 0x6077, 0.1 % of rated torque.
    pub torque: i16,
    /// 0x6064, counts.
    pub position: i32,
    /// 0x603F.
    pub error_code: u16,
}

/// What the motor is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    Off,
    Follow,
    Brake,
    Hold,
    /// Mode 6 was left in motion.
    BrakeAfterHoming,
}

/// What the loops follow, in counts of the shaft.
#[derive(Clone, Copy, Debug)]
struct Demand {
    whole: i64,
    fraction: f64,
    velocity: f64,
}

/// How near to its target an axis has reached it.
struct Reached {
    counts: u32,
    /// counts/s.
    velocity: f64,
}

/// The axis.
///
/// A cycle of 40 drives goes through all of them, and the processor fetches memory in lines of 64 bytes: what a cycle in CSP
/// uses lies side by side, first in the axis, and the rest after it.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Axis {
    measured: Measured,
    targets: Targets,
    mode: Mode,
    motion: Motion,
    /// The next target position in process data was made before the master could see where the axis is.
    stale: bool,
    /// A software position limit holds the target back.
    held_back: bool,
    reached: bool,
    /// Between the halves of a step.
    stepping: bool,
    demand: Demand,
    /// How long the following error has been outside its window.
    outside_ns: Ns,
    /// 0x6065 and 0x6066 of the settings.
    following: FollowingWindow,
    /// What positions of objects and process data have on top of the shaft's counts.
    origin: i64,
    position_reached: i64,
    limits: Option<(i64, i64)>,
    machine: StateMachine,
    plant: Plant,
    velocity_reached: f64,
    /// How long shaft and demand have been still, in mode 6 and while the axis brakes after it.
    still_ns: Ns,
    settings: Settings,
    homing: Homing,
    switches: Switches,
}

/// How far an axis may lag behind its demand, and for how long.
#[derive(Clone, Copy, Debug)]
struct FollowingWindow {
    counts: u32,
    timeout_ms: u16,
}

impl FollowingWindow {
    const fn of(settings: &Settings) -> Self {
        Self { counts: settings.following_window, timeout_ms: settings.following_timeout_ms }
    }
}

impl Axis {
    /// An axis at power-on, its shaft at `position`, in CSP.
    pub fn new(motor: &Motor, times: TransitionTimes, settings: Settings, position: i64) -> Self {
        let reached = Reached {
            // [OURS] Bit 10: within a thousandth of a turn in CSP, within 10 rpm in CSV.
            counts: (motor.counts_per_turn / 1000).max(1),
            velocity: f64::from(motor.counts_per_turn) / 6.0,
        };
        Self::moving(Plant::Servo(Servo::new(motor, position)), reached, times, settings, position)
    }

    /// The same with a train of pulses instead of a motor.
    pub fn of_pulses(train: &PulseTrain, times: TransitionTimes, settings: Settings, position: i64) -> Self {
        let reached = Reached { counts: 0, velocity: 0.0 };
        Self::moving(Plant::Pulses(Pulses::new(train, position)), reached, times, settings, position)
    }

    fn moving(plant: Plant, reached: Reached, times: TransitionTimes, settings: Settings, position: i64) -> Self {
        let mut axis = Self {
            machine: StateMachine::new(times, settings.options),
            plant,
            settings,
            following: FollowingWindow::of(&settings),
            limits: None,
            switches: Switches::new(&Travel::NONE, 1),
            homing: Homing::new(settings.homing),
            origin: 0,
            stale: false,
            still_ns: 0,
            mode: Mode::Csp,
            targets: Targets { position: position as i32, ..Targets::default() },
            motion: Motion::Off,
            demand: Demand { whole: position, fraction: 0.0, velocity: 0.0 },
            outside_ns: 0,
            held_back: false,
            reached: false,
            position_reached: i64::from(reached.counts),
            velocity_reached: reached.velocity,
            measured: Measured::default(),
            stepping: false,
        };
        axis.set(settings);
        axis.measure();
        axis
    }

    /// The objects are new.
    pub fn set(&mut self, settings: Settings) {
        let (low, high) = settings.position_limits;
        self.limits = (low < high && (low, high) != (i32::MIN, i32::MAX)).then_some((low.into(), high.into()));
        self.plant.set_limits(settings.max_velocity, settings.max_torque);
        self.machine.set_options(settings.options);
        self.following = FollowingWindow::of(&settings);
        self.settings = settings;
    }

    /// The state machine.
    pub const fn machine(&self) -> &StateMachine {
        &self.machine
    }

    /// The state machine, to command it.
    pub const fn machine_mut(&mut self) -> &mut StateMachine {
        &mut self.machine
    }

    /// The shaft.
    pub const fn plant(&self) -> &Plant {
        &self.plant
    }

    /// The mode in force (0x6061).
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// Changes the mode, at once and in any state \[OURS]. The targets are then such that the axis holds where it is,
    /// until new ones come. Homing brakes a shaft that moves, both when it is entered and when it is left.
    pub fn set_mode(&mut self, mode: Mode) {
        if mode == self.mode {
            return;
        }
        let moves = match self.motion {
            Motion::BrakeAfterHoming => true,
            Motion::Follow => self.mode == Mode::Homing && !self.stands(),
            _ => false,
        };
        self.motion = if moves && mode != Mode::Homing { Motion::BrakeAfterHoming } else { Motion::Off };
        self.mode = mode;
        self.targets = Targets { position: self.position() as i32, ..Targets::default() };
        if mode == Mode::Homing {
            self.begin_to_stand();
            self.homing.enter(self.machine.controlword(), self.settings.homing);
        }
    }

    /// The targets.
    pub const fn targets(&self) -> &Targets {
        &self.targets
    }

    /// The targets, to set them.
    pub const fn targets_mut(&mut self) -> &mut Targets {
        &mut self.targets
    }

    /// What was measured at the end of the last step.
    pub const fn measured(&self) -> &Measured {
        &self.measured
    }

    /// Position demand (0x6062), counts.
    pub const fn demand(&self) -> i64 {
        self.demand.whole.wrapping_add(self.origin)
    }

    /// Following error (0x60F4): demand - actual, counts.
    pub const fn following_error(&self) -> i64 {
        self.demand.whole.wrapping_sub(self.plant.position())
    }

    /// `dt_ns` pass, in which the targets are reached.
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

    /// The first half of [`Axis::step`]. What is handed out is to be run for that time before the second half; that way
    /// the motors of several axes run side by side. `None`: all of the time has passed.
    pub fn begin_step(&mut self, dt_ns: Ns) -> Option<Following<'_>> {
        self.stepping = false;
        let one_slice = dt_ns > 0 && dt_ns < SLICE_NS + SLICE_NS / 2;
        let follows = self.motion == Motion::Follow && matches!(self.mode, Mode::Csp);
        if !one_slice || !follows || matches!(self.plant, Plant::Pulses(_)) {
            self.step(dt_ns);
            return None;
        }
        self.machine.step(dt_ns, self.has_stopped());
        if self.machine.power() != Power::Follow {
            self.pass(dt_ns, dt_ns);
            self.measure();
            return None;
        }
        self.stepping = true;
        let effort = self.demand_position(dt_ns, dt_ns);
        match (&mut self.plant, effort) {
            (Plant::Servo(servo), Effort::Position { from, fraction, by }) => {
                Some(Following { servo, from, fraction, by })
            }
            _ => None,
        }
    }

    /// The second half, in any case.
    pub fn end_step(&mut self, dt_ns: Ns) {
        if std::mem::take(&mut self.stepping) {
            self.followed_position(dt_ns);
            self.measure();
        }
    }

    /// `ns` pass out of `left` until the targets are due.
    fn slice(&mut self, ns: Ns, left: Ns) {
        self.machine.step(ns, self.has_stopped());
        self.pass(ns, left);
        if self.mode == Mode::Homing || self.motion == Motion::BrakeAfterHoming {
            self.note_stand(ns);
        }
    }

    fn pass(&mut self, ns: Ns, left: Ns) {
        match self.machine.power() {
            Power::Off => {
                self.plant.run(Effort::Coast, ns);
                self.motion = Motion::Off;
                self.demand_here();
                self.leave_homing_unpowered();
            }
            Power::Follow => {
                if self.motion != Motion::Follow {
                    if self.motion == Motion::BrakeAfterHoming && self.brake_after_homing(ns) {
                        return;
                    }
                    self.motion = Motion::Follow;
                    self.demand_here();
                    if self.mode == Mode::Homing {
                        self.hold_for_homing();
                    }
                }
                match self.mode {
                    Mode::Csv => self.follow_velocity(ns, left),
                    Mode::Cst => self.follow_torque(ns),
                    Mode::Homing => self.home(ns),
                    Mode::Csp => self.follow_position(ns, left),
                }
            }
            Power::Stop(ramp) => {
                self.brake(ramp, ns);
                self.leave_homing_unpowered();
            }
        }
    }

    fn has_stopped(&self) -> bool {
        match self.motion {
            Motion::Off => self.plant.is_at_standstill(),
            Motion::Hold => true,
            Motion::Follow | Motion::Brake | Motion::BrakeAfterHoming => false,
        }
    }

    /// The demand is where the shaft is and as fast.
    fn demand_here(&mut self) {
        self.demand = Demand { whole: self.plant.position(), fraction: 0.0, velocity: self.plant.velocity() };
        self.outside_ns = 0;
        self.reached = false;
        self.held_back = false;
    }

    fn measure(&mut self) {
        let Shown { position, torque, limited } = self.plant.shown();
        let torque = rounded(torque * 1000.0);
        self.measured = Measured {
            statusword: self.statusword(limited),
            torque: torque.clamp(i16::MIN.into(), i16::MAX.into()) as i16,
            position: position.wrapping_add(self.origin) as i32,
            error_code: self.machine.fault().map_or(0, |fault| fault.code),
        };
    }

    /// Bits 10 to 13 on top of the state's. But for homing, off or braking: bits 10 to 12 are 0 \[OURS]. `limited`: a limit
    /// of the plant was in force.
    fn statusword(&self, limited: bool) -> Statusword {
        let mut word = self.machine.status_bits();
        if self.mode == Mode::Homing {
            let limited = self.motion == Motion::Follow && limited;
            let limit = if limited { Statusword::INTERNAL_LIMIT } else { 0 };
            return Statusword(word | limit | self.homing.status_bits(self.stands()));
        }
        if self.motion == Motion::Follow && self.machine.state() == DriveState::OperationEnabled {
            word |= Statusword::BIT12;
            if self.reached {
                word |= Statusword::TARGET_REACHED;
            }
            if self.held_back || limited {
                word |= Statusword::INTERNAL_LIMIT;
            }
        }
        if self.machine.fault().is_some_and(|fault| fault.code == FOLLOWING_ERROR) {
            word |= Statusword::BIT13;
        }
        Statusword(word)
    }
}

/// The slices of `dt_ns` that come nearest to the usual ones.
const fn slice_of<const USUAL: Ns>(dt_ns: Ns) -> Ns {
    // Most cycles are one slice, or two of homing, and divisions are a good part of the time that one takes.
    match (dt_ns + USUAL / 2) / USUAL {
        0 | 1 => dt_ns,
        2 => dt_ns / 2,
        slices => dt_ns / slices,
    }
}

/// The nearest integer, halves away from 0.
pub(super) fn rounded(x: f64) -> i64 {
    (if x < 0.0 { x - 0.5 } else { x + 0.5 }) as i64
}
