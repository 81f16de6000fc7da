//! One axis of a simulated drive or pulse module: state machine, plant, and between them the modes of operation.
//!
//! | file | what it answers |
//! | --- | --- |
//! | `axis.rs` | what an axis is made of, which settings it reads from the object dictionary, how its mode changes |
//! | `axis/step.rs` | how time passes: in slices, through the state machine to the power stage |
//! | `axis/cyclic_modes.rs` | how CSP, CSV and CST follow their targets, and how the axis brakes |
//! | `axis/following_error.rs` | when a following error is a fault (0x6065, 0x6066) |
//! | `axis/homing.rs` | how homing moves the axis, and how its position changes when home is attained |
//! | `axis/measure.rs` | what the axis reports: position, torque, error code and the bits of its statusword |
//!
//! The homing methods themselves are in [`homing`](super::homing), the states of CiA 402 in
//! [`state_machine`](super::state_machine).
//!
//! A target is reached evenly over the time of the step that follows it: [`Axis::step`] is called once after each
//! exchange of process data, with the length of the cycle, and meanwhile the demand moves from where it was to the new
//! target. The axis thus lags its targets by one cycle, and does not have to be told how long a cycle is.
//!
//! Positions are `i64` counts inside and wrap to the `i32` of objects 0x6064 and 0x607A: a target means the position
//! nearest to the present demand that has those low 32 bits, so that an axis may turn in one direction for ever.

mod cyclic_modes;
mod following_error;
mod homing;
mod measure;
mod step;

use super::homing::{Homing, HomingSettings};
use super::plant::{Motor, Plant, PulseTrain, Pulses, Servo};
use super::state_machine::{OptionCodes, StateMachine, TransitionTimes};
use super::switches::{Switches, Travel};
use crate::ethercat::Ns;
use crate::ethercat::cia402::Mode;
use following_error::FollowingErrorWindow;

pub use following_error::{FOLLOWING_ERROR, NO_FOLLOWING_WINDOW};
pub use measure::Measured;
pub(super) use measure::rounded;

/// What an axis reads from its device's objects. Times in ms, the rest in counts, counts/s and counts/s².
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Following error window, 0x6065; [`NO_FOLLOWING_WINDOW`]: the following error is not monitored.
    pub following_window: u32,
    /// Following error time out, 0x6066.
    pub following_timeout_ms: u16,
    /// Software position limits, 0x607D:1 and :2. \[OURS] Without effect unless the first is less than the second.
    pub position_limits: (i32, i32),
    /// Max profile velocity, 0x607F. \[OURS] It limits every mode.
    pub max_velocity: u32,
    /// Max torque, 0x6072, 0.1 % of rated.
    pub max_torque: u16,
    /// Profile deceleration, 0x6084: the slow-down ramp.
    pub slow_down: u32,
    /// Quick stop deceleration, 0x6085: the quick-stop ramp.
    pub quick_stop: u32,
    /// Option codes, 0x605A to 0x605E.
    pub options: OptionCodes,
    /// Objects of homing: 0x607C, 0x6098 to 0x609A, 0x605D.
    pub homing: HomingSettings,
    /// The ramp on which an axis brakes if homing mode is left while it moves; `None`: the homing acceleration, 0x609A.
    pub homing_exit: Option<u32>,
}

/// Targets of the cyclic modes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Targets {
    /// Target position, 0x607A, counts.
    pub position: i32,
    /// Target velocity, 0x60FF, counts/s.
    pub velocity: i32,
    /// Target torque, 0x6071, 0.1 % of rated.
    pub torque: i16,
    /// Whether an offset was ever written; kept here so that a cycle without offsets reads nothing else.
    has_offsets: bool,
}

/// What is added to the targets of the cyclic modes (CiA 402-2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Offsets {
    /// Position offset, 0x60B0, counts; of CSP.
    pub position: i32,
    /// Velocity offset, 0x60B1, counts/s; of CSV. \[OURS] In CSP it has no effect: the simulated loops need no feed-forward.
    pub velocity: i32,
    /// Torque offset, 0x60B2, 0.1 % of rated; of CST. \[OURS] In CSP and CSV it has no effect, for the same reason.
    pub torque: i16,
}

/// What the axis makes its motor do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    /// The power stage is off.
    Off,
    /// The motor follows the targets of a cyclic mode, or the demand of homing.
    Follow,
    /// The motor brakes on a ramp.
    Brake,
    /// The motor has braked and is held where it stands.
    Hold,
    /// The motor brakes because homing mode was left while it moved.
    BrakeAfterHoming,
}

/// The demand that the control loops follow, in counts of the shaft.
#[derive(Clone, Copy, Debug)]
struct Demand {
    whole: i64,
    fraction: f64,
    velocity: f64,
}

/// How near an axis has to be to its target for statusword bit 10, target reached.
struct ReachedWindow {
    counts: u32,
    /// counts/s.
    velocity: f64,
}

/// An axis.
///
/// A cycle of 40 drives goes through all of them, and the processor fetches memory in lines of 64 bytes: what a cycle in
/// CSP uses lies side by side, first in the axis, and the rest after it.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Axis {
    measured: Measured,
    targets: Targets,
    mode: Mode,
    motion: Motion,
    /// The next target position in process data is discarded: the master made it before it could see where the axis is.
    skip_next_target: bool,
    /// A software position limit (0x607D) or a limit switch keeps the axis from its target.
    position_limited: bool,
    /// The limit switches act in the cyclic modes, see [`Travel::limits_stop_motion`].
    limits_stop_motion: bool,
    /// In CSP the demand brakes, or stands, because of a limit switch.
    held_by_switch: bool,
    /// The target is reached, statusword bit 10.
    target_reached: bool,
    /// [`Axis::begin_step`] has handed the motor out, and [`Axis::end_step`] has not been called yet.
    motor_handed_out: bool,
    demand: Demand,
    /// How long the following error has been outside its window.
    outside_ns: Ns,
    following: FollowingErrorWindow,
    /// Position actual value where the count of the shaft is 0. Homing sets it.
    origin: i64,
    position_reached: i64,
    limits: Option<(i64, i64)>,
    machine: StateMachine,
    plant: Plant,
    velocity_reached: f64,
    /// How long shaft and demand have been at standstill, in homing mode and while the axis brakes after it.
    standstill_ns: Ns,
    settings: Settings,
    offsets: Offsets,
    homing: Homing,
    switches: Switches,
}

impl Axis {
    /// An axis at power-on, its shaft at `position`, in CSP.
    pub fn new(motor: &Motor, times: TransitionTimes, settings: Settings, position: i64) -> Self {
        let reached = ReachedWindow {
            // [OURS] Bit 10: within a thousandth of a turn in CSP, within 10 rpm in CSV.
            counts: (motor.counts_per_turn / 1000).max(1),
            velocity: f64::from(motor.counts_per_turn) / 6.0,
        };
        Self::with_plant(Plant::Servo(Servo::new(motor, position)), reached, times, settings, position)
    }

    /// The same with a train of pulses instead of a motor.
    pub fn of_pulses(train: &PulseTrain, times: TransitionTimes, settings: Settings, position: i64) -> Self {
        let reached = ReachedWindow { counts: 0, velocity: 0.0 };
        Self::with_plant(Plant::Pulses(Pulses::new(train, position)), reached, times, settings, position)
    }

    fn with_plant(
        plant: Plant,
        reached: ReachedWindow,
        times: TransitionTimes,
        settings: Settings,
        position: i64,
    ) -> Self {
        let mut axis = Self {
            machine: StateMachine::new(times, settings.options),
            plant,
            settings,
            offsets: Offsets::default(),
            following: FollowingErrorWindow::of(&settings),
            limits: None,
            switches: Switches::new(&Travel::NONE, 1),
            homing: Homing::new(settings.homing),
            origin: 0,
            skip_next_target: false,
            standstill_ns: 0,
            mode: Mode::Csp,
            targets: Targets { position: position as i32, ..Targets::default() },
            motion: Motion::Off,
            demand: Demand { whole: position, fraction: 0.0, velocity: 0.0 },
            outside_ns: 0,
            position_limited: false,
            limits_stop_motion: false,
            held_by_switch: false,
            target_reached: false,
            position_reached: i64::from(reached.counts),
            velocity_reached: reached.velocity,
            measured: Measured::default(),
            motor_handed_out: false,
        };
        axis.apply_settings(settings);
        axis.measure();
        axis
    }

    /// The same axis with switches along its travel; without this call it has none.
    pub fn with_travel(mut self, travel: &Travel, counts_per_turn: u32) -> Self {
        self.switches = Switches::new(travel, counts_per_turn);
        self.limits_stop_motion = travel.limits_stop_motion;
        self.plant.set_stops(travel.stops);
        self
    }

    /// Takes over settings that an SDO or process data have changed.
    pub fn apply_settings(&mut self, settings: Settings) {
        let (low, high) = settings.position_limits;
        self.limits = (low < high && (low, high) != (i32::MIN, i32::MAX)).then_some((low.into(), high.into()));
        self.plant.set_limits(settings.max_velocity, settings.max_torque);
        self.machine.set_options(settings.options);
        self.following = FollowingErrorWindow::of(&settings);
        self.settings = settings;
    }

    /// The CiA 402 state machine.
    pub const fn machine(&self) -> &StateMachine {
        &self.machine
    }

    /// The CiA 402 state machine, to give it a controlword or a fault.
    pub const fn machine_mut(&mut self) -> &mut StateMachine {
        &mut self.machine
    }

    /// The motor or the train of pulses.
    pub const fn plant(&self) -> &Plant {
        &self.plant
    }

    /// The mode in force (0x6061).
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// Changes the mode, at once and in any state \[OURS]. The targets are then such that the axis holds where it is,
    /// until new ones come. Homing mode brakes a shaft that moves, both when it is entered and when it is left.
    pub fn set_mode(&mut self, mode: Mode) {
        if mode == self.mode {
            return;
        }
        let moves = match self.motion {
            Motion::BrakeAfterHoming => true,
            Motion::Follow => self.mode == Mode::Homing && !self.is_standing_still(),
            _ => false,
        };
        self.motion = if moves && mode != Mode::Homing { Motion::BrakeAfterHoming } else { Motion::Off };
        self.mode = mode;
        self.targets = Targets { has_offsets: self.targets.has_offsets, ..Targets::default() };
        self.hold_target();
        if mode == Mode::Homing {
            self.reset_standstill();
            self.homing.enter(self.machine.controlword(), self.settings.homing);
        }
    }

    /// The switches along the travel.
    pub const fn switches(&self) -> &Switches {
        &self.switches
    }

    /// Sets the position actual value of where the shaft is.
    pub fn set_position(&mut self, position: i64) {
        self.origin = position.wrapping_sub(self.plant.position());
        self.hold_target();
        self.measure();
    }

    /// Whether the target position that has just come is the one that is discarded after homing, see `axis/homing.rs`.
    pub const fn skips_target(&mut self) -> bool {
        std::mem::replace(&mut self.skip_next_target, false)
    }

    /// Replaces the switches along the travel.
    pub fn set_switches(&mut self, switches: Switches) {
        self.switches = switches;
    }

    /// The position demand in counts of the shaft, whatever homing has set.
    pub const fn shaft_demand(&self) -> i64 {
        self.demand.whole
    }

    /// Whether the motor follows a target or a homing run.
    pub fn follows(&self) -> bool {
        self.motion == Motion::Follow
    }

    /// The targets in force.
    pub const fn targets(&self) -> &Targets {
        &self.targets
    }

    /// The targets, to be written by SDO or process data. Process data write the target position by
    /// [`Self::take_target_position`].
    pub const fn targets_mut(&mut self) -> &mut Targets {
        &mut self.targets
    }

    /// What is added to the targets.
    pub const fn offsets(&self) -> &Offsets {
        &self.offsets
    }

    /// The offsets, to be written by SDO or process data.
    pub const fn offsets_mut(&mut self) -> &mut Offsets {
        self.targets.has_offsets = true;
        &mut self.offsets
    }

    /// The target position becomes the one at which the axis stays where it is.
    const fn hold_target(&mut self) {
        let offset = if self.targets.has_offsets { self.offsets.position } else { 0 };
        self.targets.position = (self.position() as i32).wrapping_sub(offset);
    }

    /// Velocity demand value (0x606B), counts/s: that of the demand which the control loops follow; 0 without power.
    pub fn velocity_demand(&self) -> i64 {
        rounded(match (self.motion, self.mode) {
            (Motion::Off, _) => 0.0,
            (Motion::Follow, Mode::Csp) => self.plant.demanded_velocity(),
            _ => self.demand.velocity,
        })
    }

    /// Position demand value (0x6062), counts.
    pub const fn demand(&self) -> i64 {
        self.demand.whole.wrapping_add(self.origin)
    }

    /// Following error actual value (0x60F4): demand - actual, counts.
    pub const fn following_error(&self) -> i64 {
        self.demand.whole.wrapping_sub(self.plant.position())
    }
}
