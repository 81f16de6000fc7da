//! The 16 digital outputs and 16 digital inputs of an IO module, or of a channel of a pulse module.
//!
//! \[OURS] Output k is wired to input k: what is written is read back a cycle later, unless the inputs are forced.

use crate::ethercat::Ns;

/// How many inputs there are.
const INPUTS: Ns = 16;

/// The values that inputs are forced to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputPattern {
    /// Constant values, bit k is input k.
    Bits(u16),
    /// One input after the other is on, from input 0 to input 15 and again.
    Walk {
        /// How long each input is on; 0 counts as 1.
        step_ns: Ns,
    },
}

impl InputPattern {
    /// The inputs that long after the pattern has begun.
    const fn after(self, ns: Ns) -> u16 {
        match self {
            Self::Bits(bits) => bits,
            Self::Walk { step_ns: 0 } => 1 << (ns % INPUTS),
            Self::Walk { step_ns } => 1 << (ns / step_ns % INPUTS),
        }
    }
}

/// The digital inputs and outputs of a module, or of one of its channels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines {
    outputs: u16,
    inputs: u16,
    /// What the inputs are forced to, and for how long they have been.
    forced: Option<(InputPattern, Ns)>,
}

impl Lines {
    /// The outputs in force, bit k is output k.
    pub const fn outputs(&self) -> u16 {
        self.outputs
    }

    /// The inputs as they were at the end of the last cycle, bit k is input k.
    pub const fn inputs(&self) -> u16 {
        self.inputs
    }

    /// Sets the outputs, bit k is output k.
    pub const fn set_outputs(&mut self, bits: u16) {
        self.outputs = bits;
    }

    /// Forces the inputs to a pattern from now on; `None`: they follow the outputs again.
    pub fn force(&mut self, pattern: Option<InputPattern>) {
        self.forced = pattern.map(|pattern| (pattern, 0));
    }

    /// Whether the inputs are forced.
    pub const fn is_forced(&self) -> bool {
        self.forced.is_some()
    }

    /// `dt_ns` pass.
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
