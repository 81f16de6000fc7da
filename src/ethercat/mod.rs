//! EtherCAT itself, which all parts of the crate that deal with slaves use: its wire format, AL states and their status
//! codes, sets of slaves, CANopen over EtherCAT ([`coe`]) and the drive profile CiA 402 ([`cia402`]); integers in the byte
//! order of the wire. No I/O, no state, no `std`.
//!
//! The wire format is encoded and decoded by plain functions over slices. Values without a meaning survive decoding. No
//! other part of the crate knows an offset of it:
//!
//! | type or module | what it holds |
//! | --- | --- |
//! | [`FrameHeader`], [`Frame`], [`FrameWriter`] | Ethernet frames and the EtherCAT header |
//! | [`Command`], [`DatagramHeader`], [`Datagram`] | the 15 commands, datagrams read or changed in place |
//! | [`registers`] | the registers of a slave controller: one list of addresses, and what their bits mean |
//! | [`mailbox`] | mailbox messages with their counter, and what was wrong with one |
//! | [`coe`], [`foe`] | SDO, SDO information and emergencies; files |
//! | [`sii`] | the EEPROM of a slave: the fixed words, the categories, the checksum |

mod al_status;
mod bits;
pub mod cia402;
pub mod coe;
mod datagram;
pub mod foe;
mod frame;
mod little_endian;
pub mod mailbox;
mod named_codes;
pub mod registers;
pub mod sii;
mod slave_set;
mod wire_error;

pub use al_status::AlStatus;
pub(crate) use bits::bits;
pub use datagram::{
    Addressing, Command, DATAGRAM_HEADER_LEN, DATAGRAM_OVERHEAD, Datagram, DatagramHeader, DatagramMut, Datagrams,
};
pub use frame::{
    BROADCAST, DATA_LEN_MAX, ETHERNET_HEADER_LEN, ETHERTYPE, FRAME_HEADER_LEN, FRAME_LEN_MAX, FRAME_LEN_MIN, Frame,
    FrameHeader, FrameWriter, Protocol, each_datagram, mark_as_passed,
};
pub use little_endian::{I32Le, U16Le, U32Le};
pub use slave_set::{MAX_SLAVES, SlaveSet};
pub use wire_error::WireError;

/// A time in nanoseconds since a device was switched on, or a duration in nanoseconds.
pub type Ns = u64;

/// An end of a line of slaves, at which a network card can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CableEnd {
    /// Before the first slave, where frames begin to be worked on.
    First,
    /// Behind the last slave: a second card there closes the ring.
    Last,
}

impl CableEnd {
    /// Both ends.
    pub const BOTH: [Self; 2] = [Self::First, Self::Last];
}

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
