//! A pulse module (HSP) with one or two channels. Each channel is a CiA 402 axis in CSP or CSV whose pulses are
//! counted, with 16 digital outputs and 16 digital inputs (SK-3, SK-7). Each channel has its own homing. Axis 2 has the
//! same objects as axis 1, with indices 0x800 higher.
//!
//! \[OURS] A module has no encoder: its position is the number of pulses that it has sent. Output k of a channel is wired
//! to input k of the same channel, so a written value is read back one cycle later. Outside OP the outputs are off. The
//! limit and home switches of a channel, and the index pulse of the stepper that it drives, have separate inputs, which
//! 0x60FD does not show.

mod objects;

use super::AXES_MAX;
use super::axis::{Axis, Settings};
use super::axis_objects::AxisModel;
use super::device::{Base, Model};
use super::dictionary::Object;
use super::lines::Lines;
use super::plant::PulseTrain;
use super::process_data::Pdo;
use super::state_machine::TransitionTimes;
use super::switches::Travel;
use crate::ethercat::Ns;
use crate::ethercat::cia402::Mode;

pub use objects::{PRODUCT_CODES, REVISION};

/// The number of channels of a module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// One channel.
    #[default]
    One = 1,
    /// Two channels.
    Two = 2,
}

/// The configuration of an [`Hsp`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HspConfig {
    /// The display name of the module.
    pub name: String,
    /// Serial number, 0x1018:4.
    pub serial: u32,
    /// The number of channels.
    pub channels: Channels,
    /// The position of each channel at power-on, pulses.
    pub positions: [i64; AXES_MAX],
    /// The configuration of the pulse generator, the same for every channel.
    pub train: PulseTrain,
    /// The durations of the transitions of every channel's CiA 402 state machine.
    pub times: TransitionTimes,
    /// Pulses per turn of the steppers; an index pulse comes once per turn.
    pub pulses_per_turn: u32,
    /// The switches along the travel of each channel, in pulses. End stops have no effect, because the pulses are counted
    /// regardless.
    pub travels: [Travel; AXES_MAX],
}

/// \[OURS] Pulses per turn: a common setting of stepper drivers.
const PULSES_PER_TURN: u32 = 10_000;

impl HspConfig {
    /// The default configuration of a module with this number of channels.
    pub fn with(channels: Channels) -> Self {
        // [OURS] These times are shorter than those of a drive, because a module has no power stage to charge and no
        // brake to open.
        let times = TransitionTimes { switch_on_ns: 2_000_000, enable_ns: 2_000_000, ..TransitionTimes::default() };
        let name = match channels {
            Channels::One => "hsp",
            Channels::Two => "hsp2",
        };
        Self {
            name: name.into(),
            serial: 0,
            channels,
            positions: [0; AXES_MAX],
            train: PulseTrain::default(),
            times,
            pulses_per_turn: PULSES_PER_TURN,
            travels: [Travel::for_turn(PULSES_PER_TURN); AXES_MAX],
        }
    }
}

impl Default for HspConfig {
    fn default() -> Self {
        Self::with(Channels::One)
    }
}

/// A simulated pulse module.
#[derive(Clone, Debug)]
pub struct Hsp {
    base: Base<Hsp>,
    axes: Vec<Axis>,
    lines: [Lines; AXES_MAX],
}

impl Hsp {
    /// A module in its power-on state.
    pub fn new(config: HspConfig) -> Self {
        let HspConfig { name, serial, channels, positions, train, times, pulses_per_turn, travels } = config;
        let values = objects::defaults(&train, pulses_per_turn);
        let new = |n: usize| {
            let settings = objects::settings(&values, n);
            Axis::of_pulses(&train, times, settings, positions[n]).with_travel(&travels[n], pulses_per_turn)
        };
        let axes = (0..channels as usize).map(new).collect();
        Self {
            base: Base::new(name, serial, objects::identity_of(channels), values, objects::pdos_of(channels)),
            axes,
            lines: Default::default(),
        }
    }

    /// The axes, for tests that need values which no object shows.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The outputs of a channel (from 0); bit k is output k.
    ///
    /// # Panics
    /// If `channel` is not below [`AXES_MAX`].
    pub const fn outputs(&self, channel: usize) -> u16 {
        self.lines[channel].outputs()
    }
}

impl AxisModel for Hsp {
    fn has_mode(&self, mode: Mode) -> bool {
        mode != Mode::Cst
    }

    fn settings(&self, axis: usize) -> Settings {
        objects::settings(&self.base.values, axis)
    }
}

impl Default for Hsp {
    fn default() -> Self {
        Self::new(HspConfig::default())
    }
}

impl Model for Hsp {
    fn objects() -> &'static [Object<Self>] {
        objects::OBJECTS
    }

    fn pdos() -> &'static [Pdo<Self>] {
        objects::PDOS
    }

    fn base(&self) -> &Base<Self> {
        &self.base
    }

    fn base_mut(&mut self) -> &mut Base<Self> {
        &mut self.base
    }

    #[inline]
    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    #[inline]
    fn axes_mut(&mut self) -> &mut [Axis] {
        &mut self.axes
    }

    fn lines_mut(&mut self) -> &mut [Lines] {
        let channels = self.axes.len();
        &mut self.lines[..channels]
    }

    fn pass(&mut self, dt_ns: Ns) {
        self.lines.iter_mut().for_each(|lines| lines.pass(dt_ns));
    }

    fn lose_outputs(&mut self) {
        self.lines.iter_mut().for_each(|lines| lines.set_outputs(0));
    }
}
