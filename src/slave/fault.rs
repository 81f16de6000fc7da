//! The faults that scripts and tests can inject into a device. [`Slave::apply_fault`](super::Slave::apply_fault) applies
//! them; their script verbs are in `testbed/script/verbs.rs`.

use super::lines::InputPattern;
use super::state_machine::DeviceFault;
use super::switches::Input;

/// The error code that an axis shows at present, with an explanation for error messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisFault {
    /// The error code, 0x603F.
    pub code: u16,
    /// The meaning of the error code, according to the manual of the device or to CiA 402.
    pub meaning: &'static str,
}

/// The start or the end of a fault inside a device. Axes and channels are numbered from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// An axis goes to the state Fault; its statusword and its error code 0x603F show it.
    Alarm {
        /// The axis, from 0.
        axis: usize,
        /// The error code of the fault, and whether a fault reset clears the fault.
        fault: DeviceFault,
    },
    /// The cause of the alarm of an axis is gone: from now on a fault reset clears the alarm, even if it could not be
    /// reset before.
    AlarmCauseEnds {
        /// The axis, from 0.
        axis: usize,
    },
    /// A switch of an axis sticks at a value. A stuck index pulse no longer occurs.
    Stick {
        /// The axis, from 0.
        axis: usize,
        /// The input; `None`: every input of the axis.
        input: Option<Input>,
        /// The state in which the switch sticks, true for active; `None`: the switch works again.
        value: Option<bool>,
    },
    /// The shaft of an axis is mechanically blocked: it does not move, whatever the torque.
    Jam {
        /// The axis, from 0.
        axis: usize,
        /// Whether the shaft is blocked; false frees it.
        jammed: bool,
    },
    /// The digital inputs of a channel are forced to a pattern instead of following the outputs that they are wired to.
    ForceInputs {
        /// The channel, from 0.
        channel: usize,
        /// The pattern; `None`: the inputs follow the outputs again.
        pattern: Option<InputPattern>,
    },
}

impl Fault {
    /// The fault to apply in order to end this one, for example [`Self::Stick`] without a value. For an alarm, it ends
    /// the cause: only a fault reset by the master clears the alarm itself.
    #[must_use]
    pub const fn end(self) -> Self {
        match self {
            Self::Alarm { axis, .. } | Self::AlarmCauseEnds { axis } => Self::AlarmCauseEnds { axis },
            Self::Stick { axis, input, .. } => Self::Stick { axis, input, value: None },
            Self::Jam { axis, .. } => Self::Jam { axis, jammed: false },
            Self::ForceInputs { channel, .. } => Self::ForceInputs { channel, pattern: None },
        }
    }

    /// The faults that end every stuck switch and jam of axis `number`, and forced inputs of channel `number`.
    pub const fn all_ends(number: usize) -> [Self; 3] {
        [
            Self::Stick { axis: number, input: None, value: None },
            Self::Jam { axis: number, jammed: false },
            Self::ForceInputs { channel: number, pattern: None },
        ]
    }
}
