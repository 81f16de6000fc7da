//! The 91 functions as requests: one type each, which holds only what the manuals allow, and [`Request`] over all.
//!
//! A type encodes itself into the fields of the header that belong to it ([`Arguments`]) and the data segment, and
//! decodes itself from them. Like the chip it reads fixed layouts from the data segment, whatever the length field
//! says; only the requests that say so go by the length (XF-4.3).
//!
//! | file | requests |
//! | --- | --- |
//! | `network` | initialisation, states, slaves, clocks |
//! | `slave` | sync managers, FMMUs, assigned process data |
//! | `pdo` | process data and their configuration |
//! | `fifo` | the FIFOs of process data |
//! | `sdo` | objects of slaves |
//! | `chip` | the chip itself: packets, version, resets, error counts, PHY |
//! | `interrupt` | the interrupt lines |
//! | `helper` | the CiA 402 helper |
//! | `gpio`, `encoder`, `dac`, `adc` | inputs and outputs of the chip |
//! | `eeprom`, `raw`, `foe`, `mailbox` | EEPROMs of slaves, datagrams, files, mailboxes and emergencies |
//!
//! `table` lists all functions.

mod adc;
mod chip;
mod dac;
mod eeprom;
mod encoder;
mod fifo;
mod foe;
mod gpio;
mod helper;
mod interrupt;
mod mailbox;
mod network;
mod pdo;
mod raw;
mod sdo;
mod slave;
pub(super) mod table;

pub use adc::*;
pub use chip::*;
pub use dac::*;
pub use eeprom::*;
pub use encoder::*;
pub use fifo::*;
pub use foe::*;
pub use gpio::*;
pub use helper::*;
pub use interrupt::*;
pub use mailbox::*;
pub use network::*;
pub use pdo::*;
pub use raw::*;
pub use sdo::*;
pub use slave::*;
pub use table::Request;

pub use super::value::{
    AllPins, Analog, DacDelay, FlashAddress, FlashBytes, GpioChannel, MotorNumber, SlaveNumber, Slaves, UpperPins,
};

use super::response::{Answer, Returned};
use super::{CommandCode, Malformed, Reserve, segment};

/// The fields of a command header that belong to the request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Arguments {
    /// `par`, byte 0x0D.
    pub parameter: u8,
    /// `i0` to `i3`, bytes 0x04 to 0x07.
    pub info: [u8; 4],
    /// Word 0x08; ECAT_INIT_OP alone uses bits of it.
    pub reserve: Reserve,
    /// Word 0x0E: bytes of the data segment that are used; in SPI_RECONFIG_OP the new n.
    pub len: u16,
}

impl Arguments {
    /// All fields 0.
    pub const NONE: Self = Self { parameter: 0, info: [0; 4], reserve: Reserve::NONE, len: 0 };
}

/// A request of one function, and what is answered to it. `'d` is how long its data live, if it has any.
pub trait Call<'d>: Sized {
    /// The command code.
    const CODE: CommandCode;
    /// The parameter that names the function, with the codes 31 to 35.
    const FUNCTION: Option<u8> = None;
    /// The result; `()` if there is none.
    type Answer<'a>: Answer<'a>;

    /// Writes the data into a segment that is all 0, and returns the fields of the header.
    ///
    /// # Errors
    /// The data do not fit into the segment, or there are more than the chip takes.
    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed>;

    /// Reads the request from the fields of the header and the whole data segment.
    ///
    /// # Errors
    /// A field has a value that the manuals do not allow.
    fn decode(arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed>;

    /// Reads the result from the answer's return byte, length and whole data segment.
    ///
    /// # Errors
    /// A field has a value that the manuals do not allow.
    fn answer<'a>(&self, returned: Returned, data: &'a [u8]) -> Result<Self::Answer<'a>, Malformed> {
        Self::Answer::decode(returned, data)
    }
}

/// What is done with a request as its own type: see [`Request::visit`].
pub trait Visit {
    /// The result.
    type Output;

    /// Takes the request.
    fn call<'d, C: Call<'d>>(self, call: &C) -> Self::Output;
}

/// What a command packet is built from: a [`Call`] or a [`Request`].
pub trait Encode {
    /// Writes the data into a segment that is all 0, and returns code and fields of the header.
    ///
    /// # Errors
    /// The data do not fit into the segment, or there are more than the chip takes.
    fn command(&self, data: &mut [u8]) -> Result<(CommandCode, Arguments), Malformed>;
}

impl<'d, C: Call<'d>> Encode for C {
    fn command(&self, data: &mut [u8]) -> Result<(CommandCode, Arguments), Malformed> {
        let arguments = self.encode(data)?;
        Ok((C::CODE, Arguments { parameter: C::FUNCTION.unwrap_or(arguments.parameter), ..arguments }))
    }
}

/// A command whose code or function the manuals do not have. The chip answers it with a command error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct UnknownCommand<'d> {
    /// The code.
    pub code: CommandCode,
    /// The fields of the header.
    pub arguments: Arguments,
    /// The whole data segment.
    pub data: &'d [u8],
}

impl Request<'_> {
    /// Whether the request is done at once: its answer has the result. Any other sets the busy flag for a while.
    pub fn is_immediate(&self) -> bool {
        let parameter = match self {
            // The one command whose parameter decides it.
            Self::ReceiveMailbox(request) => request.operation(),
            _ => 0,
        };
        self.code().is_immediate(parameter)
    }
}
