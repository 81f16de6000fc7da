//! The board's six local inputs and outputs (SK-8) at pins of the chip.
//!
//! The header of every packet carries the outputs, and the header of every answer the inputs, so that neither needs an
//! exchange of its own. After each start the chip is told which pins are outputs.

use super::ask::{Ask, Asked};
use super::chip_bus::ChipBus;
use crate::ethercat::Ns;
use crate::xf::host::{HostState, Wires};

/// How many local inputs, and how many local outputs, a board has.
const LINES: usize = 6;

/// The pins of the chip that are local inputs and outputs of the board; an input or output that is not wired has no pin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LocalPins {
    /// Input k is at GPIO pin `inputs[k]` of the chip, 0 to 15; `None`: it is not wired.
    pub inputs: [Option<u8>; LINES],
    /// Output k is at GPIO pin `outputs[k]` of the chip, 0 to 11; `None`: it is not wired. These are the pins that the
    /// header of a packet drives with every firmware of the chip.
    pub outputs: [Option<u8>; LINES],
}

impl LocalPins {
    /// The highest GPIO pin of the chip that can be an input.
    pub const INPUT_MAX: u8 = 15;
    /// The highest GPIO pin of the chip that can be an output.
    pub const OUTPUT_MAX: u8 = 11;

    /// No input and no output is wired.
    pub const NONE: Self = Self { inputs: [None; LINES], outputs: [None; LINES] };

    fn mask(pins: &[Option<u8>; LINES]) -> u16 {
        pins.iter().flatten().fold(0, |mask, pin| mask | 1 << pin)
    }

    /// Converts the local outputs to the levels of the chip's pins: bit k of `bits` becomes the level of the pin of
    /// output k.
    fn spread(pins: &[Option<u8>; LINES], bits: u8) -> u16 {
        let set = pins.iter().enumerate().filter(|(line, _)| bits & 1 << line != 0);
        set.filter_map(|(_, pin)| *pin).fold(0, |mask, pin| mask | 1 << pin)
    }

    /// Converts the levels of the chip's pins to the local inputs: bit k is the level of the pin of input k.
    fn gather(pins: &[Option<u8>; LINES], levels: u16) -> u8 {
        let lines = pins.iter().enumerate().filter_map(|(line, pin)| pin.map(|pin| (line, pin)));
        lines.fold(0, |bits, (line, pin)| bits | u8::from(levels & 1 << pin != 0) << line)
    }
}

/// Whether the chip was told which of its pins are outputs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) enum PinSetup {
    /// The chip has started, or is about to start, and was not told which pins are outputs.
    #[default]
    Due,
    Asked(Asked),
    Done,
}

impl<W: Wires> ChipBus<W> {
    /// Tells the chip which pins are outputs, once it runs.
    pub(super) fn set_up_pins(&mut self, now: Ns) {
        let outputs = LocalPins::mask(&self.options.local_pins.outputs);
        if outputs == 0 {
            return;
        }
        self.pins = match self.pins {
            _ if self.host.state() != HostState::Running => PinSetup::Due,
            PinSetup::Due => {
                // The levels are set before the pins become outputs, so that no pin has a wrong level for a moment.
                self.host.set_gpio_outputs(Some(self.local_levels));
                Ask::OutputPins(outputs).submit(&mut self.host, now).map_or(PinSetup::Due, PinSetup::Asked)
            }
            PinSetup::Asked(asked) => match asked.reply(&mut self.host) {
                None => PinSetup::Asked(asked),
                Some(Ok(_)) => PinSetup::Done,
                Some(Err(_)) => PinSetup::Due,
            },
            PinSetup::Done => PinSetup::Done,
        };
    }

    pub(super) fn put_local_outputs(&mut self, bits: u8) {
        let pins = &self.options.local_pins.outputs;
        self.local_levels = LocalPins::spread(pins, bits);
        if LocalPins::mask(pins) != 0 {
            self.host.set_gpio_outputs(Some(self.local_levels));
        }
    }

    pub(super) fn take_local_inputs(&self) -> Option<u8> {
        let pins = &self.options.local_pins.inputs;
        let header = self.host.header().filter(|_| pins.iter().any(Option::is_some))?;
        Some(LocalPins::gather(pins, header.gpio_inputs))
    }
}
