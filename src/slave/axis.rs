//! One axis of a simulated drive or pulse module: the state machine, the plant, and the modes of operation that connect
//! them.
//!
//! | file | content |
//! | --- | --- |
//! | `axis.rs` | the parts of an axis, the settings it reads from the object dictionary, changes of its mode |
//! | `axis/step.rs` | the time step: slices, and the path from the state machine to the power stage |
//! | `axis/cyclic_modes.rs` | following the targets of CSP, CSV and CST; braking |
//! | `axis/following_error.rs` | the following error as a fault (0x6065, 0x6066) |
//! | `axis/homing.rs` | the motion during homing, and the change of position when home is attained |
//! | `axis/measure.rs` | the reported values: position, torque, error code and the bits of the statusword |
//!
//! The homing methods are in [`homing`](super::homing), the states of CiA 402 in [`state_machine`](super::state_machine).
//!
//! [`Axis::step`] is called once after each exchange of process data, with the length of the cycle. During this step
//! the demand moves linearly to the new target. The axis therefore lags its targets by one cycle, and it does not need
//! to know the cycle time in advance.
//!
//! Positions are `i64` counts internally and wrap to the `i32` of objects 0x6064 and 0x607A. A 32-bit target position
//! means the position with these low 32 bits that is nearest to the present demand. So an axis can turn in one
//! direction endlessly.

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

/// The settings that an axis reads from the objects of its device. Times are in ms, other values in counts, counts/s and
/// counts/s².
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Following error window, 0x6065, counts. [`NO_FOLLOWING_WINDOW`] switches the monitoring off.
    pub following_window: u32,
    /// Following error time out, 0x6066, ms.
    pub following_timeout_ms: u16,
    /// Software position limits, 0x607D:1 and :2, counts. \[OURS] Without effect unless the first limit is less than
    /// the second.
    pub position_limits: (i32, i32),
    /// Max profile velocity, 0x607F, counts/s. \[OURS] It limits every mode.
    pub max_velocity: u32,
    /// Max torque, 0x6072, 0.1 % of the rated torque.
    pub max_torque: u16,
    /// Profile deceleration, 0x6084, counts/s²: the slow-down ramp.
    pub slow_down: u32,
    /// Quick stop deceleration, 0x6085, counts/s²: the quick-stop ramp.
    pub quick_stop: u32,
    /// The option codes for the stops of the axis, 0x605A to 0x605E.
    pub options: OptionCodes,
    /// The settings of homing mode, from objects 0x607C, 0x6098 to 0x609A and 0x605D.
    pub homing: HomingSettings,
    /// The ramp on which an axis brakes if the mode changes from homing to another one while the axis moves, counts/s²;
    /// `None`: the homing acceleration, 0x609A.
    pub homing_exit: Option<u32>,
}

/// Targets of the cyclic modes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Targets {
    /// Target position, 0x607A, counts.
    pub position: i32,
    /// Target velocity, 0x60FF, counts/s.
    pub velocity: i32,
    /// Target torque, 0x6071, 0.1 % of the rated torque.
    pub torque: i16,
    /// Whether an offset has ever been written. While this is false, a cycle in CSP does not read [`Offsets`], which
    /// are in another cache line.
    has_offsets: bool,
}

/// Offsets added to the targets of the cyclic modes (CiA 402-2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Offsets {
    /// Position offset, 0x60B0, counts. Used in CSP.
    pub position: i32,
    /// Velocity offset, 0x60B1, counts/s. Used in CSV. \[OURS] It has no effect in CSP, because the simulated loops need no
    /// feed-forward.
    pub velocity: i32,
    /// Torque offset, 0x60B2, 0.1 % of rated torque. Used in CST. \[OURS] It has no effect in CSP and CSV, because the
    /// simulated loops need no feed-forward.
    pub torque: i16,
}

/// What the motor does at present.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    /// The power stage is off.
    Off,
    /// The motor follows the targets of a cyclic mode, or the demand of homing.
    Follow,
    /// The motor brakes on a ramp.
    Brake,
    /// The motor has braked and is held in its position.
    Hold,
    /// The motor brakes because homing mode was left while it moved.
    BrakeAfterHoming,
}

/// The demand that the control loops follow. The position is `whole` plus `fraction`, in counts of the shaft, without
/// the origin that homing sets. The velocity is in counts/s.
#[derive(Clone, Copy, Debug)]
struct Demand {
    whole: i64,
    fraction: f64,
    velocity: f64,
}

/// How close to the target an axis must be for statusword bit 10, target reached: in CSP in counts, in CSV in counts/s.
struct ReachedWindow {
    counts: u32,
    /// The velocity tolerance in CSV, counts/s.
    velocity: f64,
}

/// An axis of a drive or a pulse module.
///
/// The order of the fields follows the cache lines of 64 bytes: the fields that a cycle in CSP uses come first, because a
/// cycle goes through up to 40 axes.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Axis {
    measured: Measured,
    targets: Targets,
    mode: Mode,
    motion: Motion,
    /// Whether to discard the next target position in process data, because the master computed it before it could see the
    /// position that homing has set.
    skip_next_target: bool,
    /// Whether a software position limit (0x607D) or a limit switch keeps the axis from its target.
    position_limited: bool,
    /// Whether the limit switches act in the cyclic modes, see [`Travel::limits_stop_motion`].
    limits_stop_motion: bool,
    /// Whether a limit switch makes the demand brake or stand still in CSP.
    held_by_switch: bool,
    /// Whether the target is reached, statusword bit 10.
    target_reached: bool,
    /// Whether [`Axis::begin_step`] has returned the motor to its caller and [`Axis::end_step`] has not been called yet.
    motor_handed_out: bool,
    demand: Demand,
    /// The time for which the following error has been outside its window, ns.
    outside_ns: Ns,
    following: FollowingErrorWindow,
    /// The position actual value at which the shaft's count is 0. Homing changes it.
    origin: i64,
    position_reached: i64,
    limits: Option<(i64, i64)>,
    machine: StateMachine,
    plant: Plant,
    velocity_reached: f64,
    /// How long both the shaft and the demand have been at standstill, ns. Measured only in homing mode, and while the
    /// axis brakes because homing mode was left.
    standstill_ns: Ns,
    settings: Settings,
    offsets: Offsets,
    homing: Homing,
    switches: Switches,
}

impl Axis {
    /// An axis in its power-on state, in CSP, with its shaft at `position`, counts.
    pub fn new(motor: &Motor, times: TransitionTimes, settings: Settings, position: i64) -> Self {
        let reached = ReachedWindow {
            // [OURS] Bit 10 of the statusword, target reached: within a thousandth of a turn in CSP, within 10 rpm in
            // CSV.
            counts: (motor.counts_per_turn / 1000).max(1),
            velocity: f64::from(motor.counts_per_turn) / 6.0,
        };
        Self::with_plant(Plant::Servo(Servo::new(motor, position)), reached, times, settings, position)
    }

    /// An axis in its power-on state, in CSP, with a pulse train instead of a motor.
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

    /// This axis with switches along its travel. Without this call an axis has no switches.
    pub fn with_travel(mut self, travel: &Travel, counts_per_turn: u32) -> Self {
        self.switches = Switches::new(travel, counts_per_turn);
        self.limits_stop_motion = travel.limits_stop_motion;
        self.plant.set_stops(travel.stops);
        self
    }

    /// Applies settings that an SDO or process data have changed.
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

    /// The CiA 402 state machine, for passing a controlword or a fault to it.
    pub const fn machine_mut(&mut self) -> &mut StateMachine {
        &mut self.machine
    }

    /// The motor or the pulse train.
    pub const fn plant(&self) -> &Plant {
        &self.plant
    }

    /// The active mode of operation (0x6061).
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// Changes the mode immediately, in any state \[OURS]. The targets are set so that the axis holds its position until
    /// new targets come. A moving shaft brakes when homing mode is entered or left.
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

    /// The switches along the travel of the axis.
    pub const fn switches(&self) -> &Switches {
        &self.switches
    }

    /// Changes the origin so that the position actual value becomes `position`, counts. The shaft does not move.
    pub fn set_position(&mut self, position: i64) {
        self.origin = position.wrapping_sub(self.plant.position());
        self.hold_target();
        self.measure();
    }

    /// Whether the target position that has just come must be discarded, because the master computed it before it could
    /// see the position that homing has set (see `axis/homing.rs`). The call resets this: the next one returns false.
    pub const fn skips_target(&mut self) -> bool {
        std::mem::replace(&mut self.skip_next_target, false)
    }

    /// Replaces the switches along the travel of the axis.
    pub fn set_switches(&mut self, switches: Switches) {
        self.switches = switches;
    }

    /// The position demand in counts of the shaft, without the origin that homing has set.
    pub const fn shaft_demand(&self) -> i64 {
        self.demand.whole
    }

    /// Whether the motor follows targets or a homing run.
    pub fn follows(&self) -> bool {
        self.motion == Motion::Follow
    }

    /// The present targets of the cyclic modes.
    pub const fn targets(&self) -> &Targets {
        &self.targets
    }

    /// The targets, for writing by SDO or process data. For the target position, process data use
    /// [`Self::take_target_position`].
    pub const fn targets_mut(&mut self) -> &mut Targets {
        &mut self.targets
    }

    /// The offsets added to the targets.
    pub const fn offsets(&self) -> &Offsets {
        &self.offsets
    }

    /// The offsets, for writing by SDO or process data.
    pub const fn offsets_mut(&mut self) -> &mut Offsets {
        self.targets.has_offsets = true;
        &mut self.offsets
    }

    /// Sets the target position so that the axis stays at its present demand.
    const fn hold_target(&mut self) {
        let offset = if self.targets.has_offsets { self.offsets.position } else { 0 };
        self.targets.position = (self.position() as i32).wrapping_sub(offset);
    }

    /// Velocity demand value (0x606B), counts/s; 0 without power.
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
