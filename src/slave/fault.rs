//! What may go wrong in a device.

use super::lines::InputPattern;
use super::state_machine::DeviceFault;
use super::switches::Input;

/// Something that goes wrong in a device, and where in it. Axes and channels are numbered from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// An axis has a fault that its statusword and 0x603F show.
    Alarm {
        /// Which axis.
        axis: usize,
        /// Which fault.
        fault: DeviceFault,
    },
    /// An input of an axis sticks at a value. An index pulse that sticks does not come any more.
    Stick {
        /// Which axis.
        axis: usize,
        /// Which input; `None`: all of them.
        input: Option<Input>,
        /// `None`: it works again.
        value: Option<bool>,
    },
    /// The shaft of an axis is jammed: it stands whatever the torque.
    Jam {
        /// Which axis.
        axis: usize,
        /// False: it is free again.
        jammed: bool,
    },
    /// The digital inputs of a channel are forced, instead of being wired to its outputs.
    ForceInputs {
        /// Which channel.
        channel: usize,
        /// `None`: they work again.
        pattern: Option<InputPattern>,
    },
}

impl Fault {
    /// What takes it back; itself where nothing does, since a fault reset is the master's.
    #[must_use]
    pub const fn end(self) -> Self {
        match self {
            Self::Alarm { .. } => self,
            Self::Stick { axis, input, .. } => Self::Stick { axis, input, value: None },
            Self::Jam { axis, .. } => Self::Jam { axis, jammed: false },
            Self::ForceInputs { channel, .. } => Self::ForceInputs { channel, pattern: None },
        }
    }

    /// What takes back whatever may last on an axis or a channel.
    pub const fn all_ends(place: usize) -> [Self; 3] {
        [
            Self::Stick { axis: place, input: None, value: None },
            Self::Jam { axis: place, jammed: false },
            Self::ForceInputs { channel: place, pattern: None },
        ]
    }
}
