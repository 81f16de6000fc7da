//! The 16 digital outputs and 16 digital inputs of an IO module, or of a channel of a pulse module.
//!
//! \[OURS] Output k is wired to input k: a written value is read back one cycle later, unless the inputs are forced.

use crate::ethercat::Ns;

/// The number of inputs, as [`Ns`] because it divides times.
const INPUTS: Ns = 16;

/// The pattern that inputs are forced to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputPattern {
    /// Constant values; bit k is input k.
    Bits(u16),
    /// A walking 1: one input after the other is on, from input 0 to input 15, repeatedly.
    Walk {
        /// The time for which each input is on, ns; 0 counts as 1.
        step_ns: Ns,
    },
}

impl InputPattern {
    /// The values of the inputs when the pattern has run for `ns`; bit k is input k.
    const fn after(self, ns: Ns) -> u16 {
        match self {
            Self::Bits(bits) => bits,
            Self::Walk { step_ns: 0 } => 1 << (ns % INPUTS),
            Self::Walk { step_ns } => 1 << (ns / step_ns % INPUTS),
        }
    }
}

/// The digital inputs and outputs of a module, or of one channel of a module.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines {
    outputs: u16,
    inputs: u16,
    /// The pattern that the inputs are forced to, with the time since it began; `None` if they are not forced.
    forced: Option<(InputPattern, Ns)>,
}

impl Lines {
    /// The present outputs; bit k is output k.
    pub const fn outputs(&self) -> u16 {
        self.outputs
    }

    /// The inputs at the end of the last cycle; bit k is input k.
    pub const fn inputs(&self) -> u16 {
        self.inputs
    }

    /// Sets the outputs; bit k is output k.
    pub const fn set_outputs(&mut self, bits: u16) {
        self.outputs = bits;
    }

    /// Forces the inputs to a pattern from now on; with `None` they follow the outputs again.
    pub fn force(&mut self, pattern: Option<InputPattern>) {
        self.forced = pattern.map(|pattern| (pattern, 0));
    }

    /// Whether the inputs are forced.
    pub const fn is_forced(&self) -> bool {
        self.forced.is_some()
    }

    /// Ends a cycle of `dt_ns`: the inputs follow the outputs, or the pattern that they are forced to.
    pub const fn pass(&mut self, dt_ns: Ns) {
        self.inputs = match &mut self.forced {
            None => self.outputs,
            Some((pattern, ns)) => {
                let inputs = pattern.after(*ns);
                *ns = ns.saturating_add(dt_ns);
                inputs
            }
        };
    }
}
