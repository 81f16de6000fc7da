//! EtherCAT itself, the base of all parts of the crate that deal with slaves: wire format, AL states and AL status codes,
//! sets of slaves, CANopen over EtherCAT ([`coe`]), the drive profile CiA 402 ([`cia402`]), and little-endian integers. No
//! I/O, no state, no `std`.
//!
//! Plain functions over slices encode and decode the wire format. Unknown values survive decoding. No other part of the
//! crate knows an offset of the wire format.
//!
//! | type or module | content |
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

/// Nanoseconds: a duration, or a time on a clock that never goes back, such as the time since a modelled board was
/// switched on.
pub type Ns = u64;

/// One of the two ends of a line of slaves. A network card can be connected at each of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CableEnd {
    /// In front of the first slave. Slaves process frames that come from this end.
    First,
    /// Behind the last slave. A second network card at this end closes the ring.
    Last,
}

impl CableEnd {
    /// Both ends of the line of slaves.
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
    /// The next higher state, through which a slave passes on its way up; [`Self::Op`] for [`Self::Op`] itself.
    pub const fn above(self) -> Self {
        match self {
            Self::Init => Self::PreOp,
            Self::PreOp => Self::SafeOp,
            Self::SafeOp | Self::Op => Self::Op,
        }
    }
}
