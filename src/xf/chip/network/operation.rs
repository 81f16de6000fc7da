//! What a network is asked for, and what it answers.

use super::{EnterError, List, SLAVES_MAX};
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::registers::SyncManager;
use crate::ethercat::{AlState, Command, Ns};
use crate::xf::DataSize;

/// A value of an object, as far as the chip has use for it.
pub type Value = List<u8, { DataSize::MAX.get() as usize }>;
/// Slaves, and the state that each is to enter.
pub type EnteringSlaves = List<(u8, AlState), SLAVES_MAX>;
/// What became of slaves that were to enter a state.
pub type Entered = List<(u8, AlState, Result<(), EnterError>), SLAVES_MAX>;

/// What a network is asked for, one thing at a time. Slaves are numbered from 0.
#[allow(clippy::large_enum_variant, reason = "there is one at a time, and boxing it would allocate")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Slaves are counted, those that answer are brought to Init, and their EEPROMs are read.
    Scan,
    /// The states of all slaves are read.
    ReadStates,
    /// Each of these slaves is brought to a state.
    Enter(EnteringSlaves),
    /// SDO upload.
    Read {
        /// Whose object.
        slave: u8,
        /// Which object.
        object: ObjectAddress,
        /// As a whole or not.
        scope: SdoScope,
        /// How many bytes of the value are of use.
        room: usize,
        /// How long the slave may take for each answer.
        timeout_ns: Ns,
    },
    /// SDO download.
    Write {
        /// Whose object.
        slave: u8,
        /// Which object.
        object: ObjectAddress,
        /// As a whole or not.
        scope: SdoScope,
        /// The whole value.
        value: Value,
        /// How long the slave may take for each answer.
        timeout_ns: Ns,
    },
    /// A datagram goes out.
    Datagram {
        /// Its command.
        command: Command,
        /// Its address, as [`DatagramHeader::address`](crate::ethercat::DatagramHeader::address) has it.
        address: u32,
        /// Its data.
        data: Vec<u8>,
    },
    /// Words of an EEPROM are read.
    ReadEeprom {
        /// Whose EEPROM.
        slave: u8,
        /// The first word.
        word: u16,
        /// How many words.
        count: usize,
    },
    /// A word of an EEPROM is written.
    WriteEeprom {
        /// Whose EEPROM.
        slave: u8,
        /// Which word.
        word: u16,
        /// What is written.
        value: u16,
    },
    /// A sync manager is set otherwise than the EEPROM says: at once, and whenever it is set again.
    SetManager {
        /// Whose sync manager.
        slave: u8,
        /// Which one.
        number: u8,
        /// Its registers.
        registers: SyncManager,
    },
    /// A file is read.
    ReadFile {
        /// Whose file.
        slave: u8,
        /// Its name.
        name: Vec<u8>,
        /// Its password.
        password: u32,
        /// How long the slave may take for each packet.
        timeout_ns: Ns,
    },
    /// A file is written.
    WriteFile {
        /// Whose file.
        slave: u8,
        /// Its name.
        name: Vec<u8>,
        /// Its password.
        password: u32,
        /// What is in it.
        content: Vec<u8>,
        /// How long the slave may take for each packet.
        timeout_ns: Ns,
    },
    /// The message in the mailbox of a slave is read.
    ReceiveMail {
        /// Whose mailbox.
        slave: u8,
    },
}

/// What a network answers. Which one belongs to an [`Operation`] has its name.
#[allow(clippy::large_enum_variant, reason = "there is one at a time, and boxing it would allocate")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// [`Operation::Scan`]: how many slaves were found, [`SLAVES_MAX`](super::SLAVES_MAX) at most.
    Scanned(u8),
    /// [`Operation::ReadStates`].
    StatesRead,
    /// [`Operation::Enter`]: what became of each slave.
    Entered(Entered),
    /// [`Operation::Read`]: the value up to the room for it, and the length of the whole value; or the abort code,
    /// [`AbortCode::TIMEOUT`] if the slave does not answer.
    Value(Result<(Value, usize), AbortCode>),
    /// [`Operation::Write`]: nothing, or the abort code as for [`Self::Value`].
    Written(Result<(), AbortCode>),
    /// [`Operation::Datagram`]: data and working counter; `None`: it did not come back.
    Datagram(Option<(Vec<u8>, u16)>),
    /// [`Operation::ReadEeprom`] and [`Operation::WriteEeprom`]: the words that were read.
    Eeprom(Result<Vec<u16>, EepromFailure>),
    /// [`Operation::SetManager`]: whether the slave has taken it.
    ManagerSet(bool),
    /// [`Operation::ReadFile`] and [`Operation::WriteFile`]: the file that was read; or the error code of FoE,
    /// [`AbortCode::TIMEOUT`] if the slave does not answer.
    File(Result<Vec<u8>, u32>),
    /// [`Operation::ReceiveMail`]: the message as it lay in the mailbox; `None`: there is none, or the slave does not answer.
    Mail(Option<Vec<u8>>),
    /// The network knows nothing of the kind.
    Unknown,
}

/// Why an EEPROM was not read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EepromFailure {
    /// The slave does not answer.
    NoAnswer,
    /// The EEPROM, or something else that uses it, is busy for too long.
    Busy,
    /// The EEPROM refuses the command.
    Refused,
}
