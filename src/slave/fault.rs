//! The faults that scripts and tests can cause inside a device. [`Slave::apply_fault`](super::Slave::apply_fault) applies
//! them, and the verbs of scripts for them stand in `testbed/script/verbs.rs`.

use super::lines::InputPattern;
use super::state_machine::DeviceFault;
use super::switches::Input;

/// A fault that an axis has, for people who look at it from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisFault {
    /// The error code, 0x603F.
    pub code: u16,
    /// What is wrong, in the words of the device: by its manual, or by CiA 402.
    pub meaning: &'static str,
}

/// A fault inside a device, or its end. Axes and channels are numbered from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// An axis goes to the state Fault; its statusword and its error code 0x603F show it.
    Alarm {
        /// The axis.
        axis: usize,
        /// The error code, and whether a fault reset clears it.
        fault: DeviceFault,
    },
    /// An input of an axis sticks at a value. An index pulse that sticks does not come any more.
    Stick {
        /// The axis.
        axis: usize,
        /// The input; `None`: every input of the axis.
        input: Option<Input>,
        /// The value; `None`: the input works again.
        value: Option<bool>,
    },
    /// The shaft of an axis is jammed: it does not move, whatever the torque.
    Jam {
        /// The axis.
        axis: usize,
        /// False: the shaft is free again.
        jammed: bool,
    },
    /// The digital inputs of a channel are forced to a pattern, instead of following the outputs that they are wired to.
    ForceInputs {
        /// The channel.
        channel: usize,
        /// The pattern; `None`: the inputs follow the outputs again.
        pattern: Option<InputPattern>,
    },
}

impl Fault {
    /// The fault that ends this one. An alarm is its own end, since only a fault reset by the master clears it.
    #[must_use]
    pub const fn end(self) -> Self {
        match self {
            Self::Alarm { .. } => self,
            Self::Stick { axis, input, .. } => Self::Stick { axis, input, value: None },
            Self::Jam { axis, .. } => Self::Jam { axis, jammed: false },
            Self::ForceInputs { channel, .. } => Self::ForceInputs { channel, pattern: None },
        }
    }

    /// The ends of all faults that may last on the axis or the channel with that number.
    pub const fn all_ends(number: usize) -> [Self; 3] {
        [
            Self::Stick { axis: number, input: None, value: None },
            Self::Jam { axis: number, jammed: false },
            Self::ForceInputs { channel: number, pattern: None },
        ]
    }
}
