//! A pulse module (HSP) of one or two channels: each is a CiA 402 axis in CSP or CSV whose pulses are counted, with 16
//! digital outputs and 16 digital inputs (SK-3, SK-7). Each does homing, too, on its own. Axis 2 has the objects of axis 1,
//! 0x800 higher.
//!
//! \[OURS] A module has no shaft to look at: its position is the pulses it has sent. Output k of a channel is wired to
//! input k of the same channel: what is written is read back a cycle later. Outside OP the outputs are off. The switches of
//! a channel's travel and the index pulse of the stepper that it drives have lines of their own, which 0x60FD does not show.

mod objects;

use super::axis::Axis;
use super::device::{Base, Model, mode_refused, not_of_this_kind};
use super::dictionary::Object;
use super::lines::Lines;
use super::plant::PulseTrain;
use super::state_machine::TransitionTimes;
use super::switches::Travel;
use crate::cia402::Mode;
use crate::coe::AbortCode;
use crate::ethercat::Ns;
use crate::fieldbus::{MAX_AXES, Refusal, Role, SlaveIn, SlaveOut};

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
    pub positions: [i64; MAX_AXES],
    /// The pulses of every channel.
    pub train: PulseTrain,
    /// How long the transitions of every channel take.
    pub times: TransitionTimes,
    /// Pulses of a turn of the steppers: so often comes their index pulse.
    pub pulses_per_turn: u32,
    /// What is along the way of every channel, in pulses. End stops have no effect: pulses are counted all the same.
    pub travels: [Travel; MAX_AXES],
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
            positions: [0; MAX_AXES],
            train: PulseTrain::default(),
            times,
            pulses_per_turn: PULSES_PER_TURN,
            travels: [Travel::for_turn(PULSES_PER_TURN); MAX_AXES],
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
    base: Base,
    axes: Vec<Axis>,
    lines: [Lines; MAX_AXES],
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
        Self { base: Base::new(name, serial, objects::identity_of(channels), values), axes, lines: Default::default() }
    }

    /// The axes, for measurements that no object shows.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The outputs of a channel (from 0) as they are, bit k is output k.
    ///
    /// # Panics
    /// If `channel` is not below [`MAX_AXES`].
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

    fn base(&self) -> &Base {
        &self.base
    }

    fn base_mut(&mut self) -> &mut Base {
        &mut self.base
    }

    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    fn axes_mut(&mut self) -> &mut [Axis] {
        &mut self.axes
    }

    fn take_role(&mut self, role: Role) -> Result<(), Refusal> {
        let Role::Hsp(mode) = role else { return Err(not_of_this_kind()) };
        if mode == Mode::Homing {
            // It has no outputs of its own: a channel enters it by 0x6060.
            return Err(mode_refused(AbortCode::VALUE_RANGE));
        }
        (0..self.axes.len()).try_for_each(|channel| self.set_mode(channel, mode.code().into())).map_err(mode_refused)
    }

    fn put_inputs(&self, inputs: &mut SlaveIn) {
        for (input, (_, lines)) in inputs.iter_mut().zip(self.axes.iter().zip(&self.lines)) {
            input.inputs = lines.inputs();
        }
    }

    fn take_outputs(&mut self, outputs: &SlaveOut) {
        for (lines, (_, out)) in self.lines.iter_mut().zip(self.axes.iter().zip(outputs)) {
            lines.set_outputs(out.outputs);
        }
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
