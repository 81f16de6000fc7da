//! The curves of the inputs and outputs of an IO slave: one for each bit that was ever 1.

use ecmsk::sk::{CommandId, IoResponse, SlaveCommand};

use super::Window;
use super::decimate::{Line, Pieces};

/// The number of inputs of an IO slave; it has as many outputs.
const BITS: usize = 16;

/// Whether a bit of an IO slave is an input or an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// An input.
    In,
    /// An output.
    Out,
}

/// The curve of one input or output.
pub struct Lane {
    /// Whether the bit is an input or an output.
    pub way: Way,
    /// The number of the bit, from 0.
    pub bit: usize,
    /// The values over time, 0 or 1.
    pub values: Pieces,
}

/// Builds the curves of the inputs and outputs of one slave while the frames of a recording are read.
pub struct Lanes {
    ways: [Bits; 2],
}

struct Bits {
    lines: [Line; BITS],
    /// The bits that were ever 1.
    used: u16,
    /// The latest value of all bits; `None` if it is unknown.
    now: Option<u16>,
}

impl Lanes {
    /// Creates empty curves for the time range `window`, which is drawn `columns` pixels wide.
    pub fn new(window: Window, columns: u32) -> Self {
        let bits = || Bits { lines: std::array::from_fn(|_| Line::holding(window, columns)), used: 0, now: None };
        Self { ways: [bits(), bits()] }
    }

    /// Draws the outputs that a command sets, at the time when the board executes the command.
    pub fn executed(&mut self, at_ns: i64, order: &SlaveCommand) {
        if let SlaveCommand::IoWrite(outputs) = order {
            self.ways[Way::Out as usize].push(at_ns, *outputs);
        }
    }

    /// Draws the inputs from the slave's slot of a report in OP. The answer to IO_WR contains the outputs and no inputs
    /// (SK-3.17), so it is not used.
    pub fn report(&mut self, at_ns: i64, slot: &IoResponse) {
        let id = CommandId::from_code(slot.head.id);
        if matches!(id, CommandId::GetStatus | CommandId::IoRead) {
            self.ways[Way::In as usize].push(at_ns, slot.bits);
        }
    }

    /// Interrupts the curves, because the bits are unknown from `at_ns` on.
    pub fn interrupt(&mut self, at_ns: i64) {
        for bits in &mut self.ways {
            bits.now = None;
            bits.lines.iter_mut().for_each(|line| line.interrupt(at_ns));
        }
    }

    /// Returns the curves of the bits that were ever 1, inputs first. Bits that were always 0 or unknown are left out.
    pub fn finish(self) -> Vec<Lane> {
        let lanes = [Way::In, Way::Out].into_iter().zip(self.ways).flat_map(|(way, bits)| {
            let used = bits.used;
            let lines = bits.lines.into_iter().enumerate().filter(move |(bit, _)| used >> bit & 1 != 0);
            lines.map(move |(bit, line)| Lane { way, bit, values: line.finish() })
        });
        lanes.collect()
    }
}

impl Bits {
    fn push(&mut self, at_ns: i64, value: u16) {
        let changed = self.now.map_or(u16::MAX, |before| before ^ value);
        self.now = Some(value);
        self.used |= value;
        for (bit, line) in self.lines.iter_mut().enumerate().filter(|(bit, _)| changed >> bit & 1 != 0) {
            line.push(at_ns, f64::from(value >> bit & 1));
        }
    }
}
