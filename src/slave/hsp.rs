//! A pulse module (HSP) of one or two channels: each is a CiA 402 axis in CSP or CSV whose pulses are counted, with 16
//! digital outputs and 16 digital inputs (SK-3, SK-7). Each does homing, too, on its own. Axis 2 has the objects of axis 1,
//! 0x800 higher.
//!
//! \[OURS] A module has no shaft to look at: its position is the pulses it has sent. Output k of a channel is wired to
//! input k of the same channel: what is written is read back a cycle later. Outside OP the outputs are off. The switches of
//! a channel's travel and the index pulse of the stepper that it drives have lines of their own, which 0x60FD does not show.

mod objects;

use super::AXES_MAX;
use super::axis::Axis;
use super::device::{Base, Model};
use super::dictionary::Object;
use super::lines::Lines;
use super::plant::PulseTrain;
use super::process_data::Pdo;
use super::state_machine::TransitionTimes;
use super::switches::Travel;
use crate::cia402::Mode;
use crate::coe::AbortCode;
use crate::ethercat::Ns;

pub use objects::{PRODUCT_CODES, REVISION};

/// How many channels a module has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// One.
    #[default]
    One = 1,
    /// Two.
    Two = 2,
}

/// How an [`Hsp`] differs from the one it is by default.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HspConfig {
    /// Its name for people.
    pub name: String,
    /// Serial number, 0x1018:4.
    pub serial: u32,
    /// One channel or two.
    pub channels: Channels,
    /// What its counters stand at at power-on.
    pub positions: [i64; AXES_MAX],
    /// The pulses of every channel.
    pub train: PulseTrain,
    /// How long the transitions of every channel take.
    pub times: TransitionTimes,
    /// Pulses of a turn of the steppers: so often comes their index pulse.
    pub pulses_per_turn: u32,
    /// What is along the way of every channel, in pulses. End stops have no effect: pulses are counted all the same.
    pub travels: [Travel; AXES_MAX],
}

/// \[OURS] What many stepper drivers are set to.
const PULSES_PER_TURN: u32 = 10_000;

impl HspConfig {
    /// The module with that many channels, by default.
    pub fn with(channels: Channels) -> Self {
        // [OURS] No power stage charges, no brake opens.
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

/// The module.
#[derive(Clone, Debug)]
pub struct Hsp {
    base: Base<Hsp>,
    axes: Vec<Axis>,
    lines: [Lines; AXES_MAX],
}

impl Hsp {
    /// A module that is switched on now.
    pub fn new(config: HspConfig) -> Self {
        let HspConfig { name, serial, channels, positions, train, times, pulses_per_turn, travels } = config;
        let values = objects::defaults(&train, pulses_per_turn);
        let new = |n: usize| {
            let settings = objects::settings(&values, n);
            Axis::of_pulses(&train, times, settings, positions[n]).on(&travels[n], pulses_per_turn)
        };
        let axes = (0..channels as usize).map(new).collect();
        Self {
            base: Base::new(name, serial, objects::identity_of(channels), values, objects::pdos_of(channels)),
            axes,
            lines: Default::default(),
        }
    }

    /// The axes, for measurements that no object shows.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The outputs of a channel (from 0) as they are, bit k is output k.
    ///
    /// # Panics
    /// If `channel` is not below [`AXES_MAX`].
    pub const fn outputs(&self, channel: usize) -> u16 {
        self.lines[channel].outputs()
    }

    /// Objects that a channel works with are new.
    fn settings_changed(&mut self, channel: usize) {
        self.axes[channel].set(objects::settings(&self.base.values, channel));
    }

    fn set_mode(&mut self, channel: usize, code: i64) -> Result<(), AbortCode> {
        match u8::try_from(code).ok().and_then(Mode::from_code) {
            Some(mode @ (Mode::Homing | Mode::Csp | Mode::Csv)) => {
                self.axes[channel].set_mode(mode);
                Ok(())
            }
            _ => Err(AbortCode::VALUE_RANGE),
        }
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

    fn axes(&self) -> &[Axis] {
        &self.axes
    }

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
