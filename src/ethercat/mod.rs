//! Types of EtherCAT itself, which all parts of the crate that deal with slaves use: AL states, sets of slaves, CANopen
//! over EtherCAT ([`coe`]) and the drive profile CiA 402 ([`cia402`]); integers in the byte order of the wire. No I/O,
//! no state, no `std`.

pub mod cia402;
pub mod coe;
mod little_endian;
mod slave_set;

pub use little_endian::{I32Le, U16Le, U32Le};
pub use slave_set::{MAX_SLAVES, SlaveSet};

/// A time in nanoseconds since a device was switched on, or a duration in nanoseconds.
pub type Ns = u64;

/// The EtherCAT state of a slave: its AL state (ETG.1000.6 6.4.1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum AlState {
    /// Init: neither mailbox nor process data.
    #[default]
    Init = 1,
    /// Pre-operational: mailbox communication.
    PreOp = 2,
    /// Safe-operational: mailbox communication and inputs.
    SafeOp = 4,
    /// Operational: mailbox communication, inputs and outputs.
    Op = 8,
}

impl AlState {
    /// The next higher state, in which a slave that goes up is first; above [`Self::Op`] there is none.
    pub const fn above(self) -> Self {
        match self {
            Self::Init => Self::PreOp,
            Self::PreOp => Self::SafeOp,
            Self::SafeOp | Self::Op => Self::Op,
        }
    }
}

/// The AL status code: why a slave refuses a change of its AL state, or has left a state (ETG.1000.6 table 11).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlStatus(pub u16);

impl AlStatus {
    /// Invalid requested state change.
    pub const INVALID_CHANGE: Self = Self(0x0011);
    /// Sync manager watchdog.
    pub const WATCHDOG: Self = Self(0x001B);
    /// Invalid output configuration: sync manager 2 is not as long as the outputs that are mapped.
    pub const INVALID_OUTPUTS: Self = Self(0x001D);
    /// Invalid input configuration: sync manager 3 is not as long as the inputs that are mapped.
    pub const INVALID_INPUTS: Self = Self(0x001E);
    /// Invalid input mapping (0x1A00 to 0x1BFF, 0x1C13).
    pub const INVALID_INPUT_MAPPING: Self = Self(0x0024);
    /// Invalid output mapping (0x1600 to 0x17FF, 0x1C12).
    pub const INVALID_OUTPUT_MAPPING: Self = Self(0x0025);
}
