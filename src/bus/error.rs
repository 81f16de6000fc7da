//! The errors of inspecting a network.

use crate::address::uri::UriError;
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::Strangers;
use crate::link::LinkError;
use crate::master::{DatagramError, FileError, MailboxError, ScanError, SdoError, SiiError, StateError};
use crate::xf_api::XfError;

/// Why the inspection of a network failed. Every text ends with the next step.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum BusError {
    /// The link cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The chip, or the link to it, reports an error.
    #[error(transparent)]
    // Boxed, because every error is as large as its largest variant.
    Chip(Box<XfError>),
    /// The chip failed to read or to write an EEPROM.
    #[error(
        "slave {slave}: the chip reports error {error} for its EEPROM; is the slave there, and its EEPROM not write protected"
    )]
    ChipEeprom { slave: u8, error: u8 },
    /// The link leads to a board. A board gives no access to the registers and EEPROMs of its slaves, which inspection
    /// needs.
    #[error(
        "`{link}` is a board, which reports little of its network; use `ecmsk info` and `ecmsk sdo` for it, or plug \
         the drives' cable into a network card and name that, e.g. --link nic:eth1"
    )]
    IsBoard { link: String },
    /// The network card is gone. If the network is a ring with two cards, both are gone.
    #[error("{text}")]
    CardGone { text: String },
    /// The scan failed, see [`ScanError`].
    #[error("the slaves were not found: {0}")]
    Scan(#[from] ScanError),
    /// No slave answers.
    #[error("no slave answers; look at the cable to the first slave and at the slaves' power")]
    NoSlave,
    /// No slave answers, and the frames come back unchanged.
    #[error("no slave answers: {}", Strangers::echo(*.frames))]
    Echo { frames: u64 },
    /// A slave is in OP, so another master runs the network.
    #[error(
        "slave {slave} is in OP: another master runs this network, or did until just now; end that program, or if \
         there is none, switch the slaves off and on"
    )]
    Runs { slave: u8 },
    /// There is no slave with this number.
    #[error("there is no slave {slave}, but {}; number them from 1 in the order of the cable", slaves(*.found))]
    NoSuchSlave { slave: u8, found: usize },
    /// A slave that the scan found does not answer any more.
    #[error("slave {slave} does not answer any more; check its cable and its power")]
    Gone { slave: u8 },
    /// A register could not be read or written.
    #[error("slave {slave}, register 0x{address:04X}: {error}; check the slave's cable and its power")]
    Register { slave: u8, address: u16, error: DatagramError },
    /// A slave does not reach PreOP.
    #[error("{0}; look at the AL status code in the slave's manual, and read its EEPROM with `ecmsk bus sii read`")]
    State(StateError),
    /// A slave does not support CoE.
    #[error("slave {slave} has no objects: its EEPROM declares no CoE; see `ecmsk bus sii read {slave}`")]
    NoCoe { slave: u8 },
    /// A slave does not support the SDO information service.
    #[error(
        "slave {slave} does not list its objects (no SDO information); read them one by one with `ecmsk bus sdo read \
         {slave} OBJECT`, by its manual"
    )]
    NoInformation { slave: u8 },
    /// An SDO transfer failed.
    #[error("slave {slave}, object {object}: {}", sdo(.error))]
    Sdo { slave: u8, object: ObjectAddress, error: SdoError },
    /// A request of the SDO information service failed.
    #[error("slave {slave}, list of its objects: {}", sdo(.error))]
    Information { slave: u8, error: SdoError },
    /// An EEPROM could not be read or written.
    #[error("slave {slave}: {error}{}", eeprom(*.error))]
    Eeprom { slave: u8, error: SiiError },
    /// The new content does not fit the slave's EEPROM.
    #[error(transparent)]
    Content(#[from] super::content_error::ContentError),
    /// A word of an EEPROM reads back with another value than was written.
    #[error(
        "slave {slave}: word 0x{word:04X} of its EEPROM was written and reads back as 0x{found:04X}, not 0x{wanted:04X}; write it \
         once more, and do not switch the slave off before that"
    )]
    NotWritten { slave: u8, word: u16, wanted: u16, found: u16 },
    /// A slave does not support FoE.
    #[error("slave {slave} has no files: its EEPROM declares no FoE; see `ecmsk bus sii read {slave}`")]
    NoFoe { slave: u8 },
    /// A file could not be read or written.
    #[error("slave {slave}, file {name}: {}", file(.error))]
    File { slave: u8, name: String, error: FileError },
}

impl From<XfError> for BusError {
    /// Wraps an error of the chip's API. Slave numbers in it are raised by 1: the chip counts slaves from 0, and this
    /// module from 1.
    fn from(mut error: XfError) -> Self {
        if let XfError::StateStuck { slaves, .. } = &mut error {
            slaves.iter_mut().for_each(|(slave, ..)| *slave = slave.saturating_add(1));
        }
        Self::Chip(Box::new(error))
    }
}

impl From<UriError> for BusError {
    fn from(error: UriError) -> Self {
        Self::Link(error.into())
    }
}

fn slaves(found: usize) -> String {
    match found {
        0 => "none".to_owned(),
        1 => "1 slave".to_owned(),
        found => format!("{found} slaves"),
    }
}

/// The text of a mailbox error, with the next step.
fn mailbox(error: MailboxError) -> String {
    match error {
        MailboxError::NoAnswer => error.to_string(),
        MailboxError::TimeUp => format!("{error}; ask it once more, it may be busy"),
        MailboxError::NoMailbox => format!("{error}; see `ecmsk bus sii read`"),
        error => format!("{error}; switch the slave off and on, and try again"),
    }
}

fn sdo(error: &SdoError) -> String {
    match error {
        SdoError::Abort(code @ (AbortCode::NO_OBJECT | AbortCode::NO_SUB_INDEX)) => {
            format!("{}; see what there is with `ecmsk bus sdo list`", SdoError::Abort(*code))
        }
        SdoError::Abort(_) => format!("{error}; see the slave's manual"),
        SdoError::Mailbox(error) => mailbox(*error),
    }
}

fn file(error: &FileError) -> String {
    match error {
        FileError::File(_) => {
            format!("{error}; see the slave's manual for its files, and for those that need bootstrap")
        }
        FileError::Mailbox(error) => mailbox(*error),
    }
}

const fn eeprom(error: SiiError) -> &'static str {
    match error {
        SiiError::Busy => "; switch it off and on",
        SiiError::Command(_) => "; its EEPROM may be broken, or write protected",
        SiiError::Empty(_) | SiiError::Checksum { .. } | SiiError::NoEnd { .. } => {
            "; write one with `ecmsk bus sii write`"
        }
        _ => "",
    }
}
