//! All functions as requests: one type each, which holds only values that the manuals allow, and the enum
//! [`Request`] of all.
//!
//! A type encodes itself into its fields of the header ([`Arguments`]) and the data segment, and decodes itself from
//! them. Like the chip it reads fixed layouts from the data segment, whatever the length field says. Only requests
//! whose descriptions say so use the length field (XF-4.3).
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
//! `table` lists all functions, each with its file.

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

pub use adc::AdcMode;
pub(super) use chip::data_size;
pub use chip::{AsyncResetActions, WkcErrorLimit};
pub use dac::DacTrigger;
pub use eeprom::EepromOperation;
pub use encoder::EncoderMode;
pub use fifo::{FIFO_ENTRIES, Fifo, Fifos};
pub use foe::FoeFile;
pub use gpio::{DebounceClock, DebounceSource, GpioMode, GpioPull, GpioTrigger};
pub use helper::HelperControl;
pub use interrupt::{InterruptEnable, PeripheralInterrupts, Polarity};
pub use mailbox::{EMERGENCIES_MAX, EmergencyCount, MailboxPart, SlaveBits};
pub use network::{DcTiming, ReferenceClock, SlaveInfoItem, WorkingCounterItem};
pub use pdo::{MappedObject, PdoAssignment, PdoConfig, PdoConfigForm, PdoMap, PdoOperation};
pub(crate) use raw::RAW_HEAD;
pub(super) use raw::raw_data;
pub use raw::{RAW_DATA_MAX, RawOperation};
pub(crate) use sdo::SDO_HEAD;
pub use sdo::{SDO_DATA_MAX, SdoOperation};
pub use slave::Direction;
pub use table::Request;
pub use table::types::*;

pub use super::value::{
    AllPins, Analog, DacDelay, FlashAddress, FlashBytes, GpioChannel, MotorNumber, SlaveNumber, Slaves, UpperPins,
};

use super::response::{Answer, Returned};
use super::{CommandCode, Malformed, Reserve};

/// The fields of a command header that belong to the request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Arguments {
    /// The parameter `par`, byte 0x0D.
    pub parameter: u8,
    /// The information bytes `i0` to `i3`, bytes 0x04 to 0x07.
    pub info: [u8; 4],
    /// The reserve bits, word 0x08; only ECAT_INIT_OP uses them.
    pub reserve: Reserve,
    /// Word 0x0E: the number of used bytes in the data segment; in SPI_RECONFIG_OP the new size of the data segment.
    pub len: u16,
}

impl Arguments {
    /// The fields of a request without arguments and without data: all are 0.
    pub const NONE: Self = Self { parameter: 0, info: [0; 4], reserve: Reserve::NONE, len: 0 };
}

/// A request of one function, with the type of its answer. `'d` is the lifetime of its data, if it has any.
pub trait Call<'d>: Sized {
    /// The code of the command that carries the request.
    const CODE: CommandCode;
    /// The parameter that selects the function, for the codes 31 to 35.
    const FUNCTION: Option<u8> = None;
    /// The type of the result; `()` if there is none.
    type Answer<'a>: Answer<'a>;

    /// Writes the data into a segment that is all 0, and returns the fields of the header.
    ///
    /// # Errors
    /// The data do not fit into the segment, or exceed a limit of the chip.
    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed>;

    /// Decodes the request from the fields of the header and the whole data segment.
    ///
    /// # Errors
    /// A field has a value that the manuals do not allow.
    fn decode(arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed>;

    /// Decodes the result from the answer's return byte, length and whole data segment.
    ///
    /// # Errors
    /// A field has a value that the manuals do not allow.
    fn answer<'a>(&self, returned: Returned, data: &'a [u8]) -> Result<Self::Answer<'a>, Malformed> {
        Self::Answer::decode(returned, data)
    }
}

/// A visitor of requests, which is called with the concrete type of a request: see [`Request::visit`].
pub trait Visit {
    /// The type of the result that [`Request::visit`] passes on.
    type Output;

    /// Called once by [`Request::visit`], with the request as a value of its own type.
    fn call<'d, C: Call<'d>>(self, call: &C) -> Self::Output;
}

/// A [`Call`] or a [`Request`], from which a command packet can be built.
pub trait Encode {
    /// Writes the data into a segment that is all 0, and returns the command code and the fields of the header.
    ///
    /// # Errors
    /// The data do not fit into the segment, or exceed a limit of the chip.
    fn command(&self, data: &mut [u8]) -> Result<(CommandCode, Arguments), Malformed>;
}

impl<'d, C: Call<'d>> Encode for C {
    fn command(&self, data: &mut [u8]) -> Result<(CommandCode, Arguments), Malformed> {
        let arguments = self.encode(data)?;
        Ok((C::CODE, Arguments { parameter: C::FUNCTION.unwrap_or(arguments.parameter), ..arguments }))
    }
}

/// A command whose code or function is not in the manuals. The chip answers it with a command error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct UnknownCommand<'d> {
    /// The code of the command; it is in the manuals if only the function is unknown.
    pub code: CommandCode,
    /// The fields of the command's header.
    pub arguments: Arguments,
    /// The whole data segment.
    pub data: &'d [u8],
}

impl Request<'_> {
    /// Whether the request is complete at once, with its result in the answer. Any other request sets the busy flag for
    /// a while.
    pub fn is_immediate(&self) -> bool {
        let parameter = match self {
            // RECV_MAILBOX is the only command for which the parameter decides this.
            Self::ReceiveMailbox(request) => request.operation(),
            _ => 0,
        };
        self.code().is_immediate(parameter)
    }
}
