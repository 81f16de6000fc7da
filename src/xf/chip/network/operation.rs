//! The operations of a network, and their answers.

use super::{EnterError, List, SLAVES_MAX};
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::registers::SyncManager;
use crate::ethercat::{AlState, Command, Ns};
use crate::xf::DataSize;

/// The value of an object, limited to the size of a data segment.
pub type SdoData = List<u8, { DataSize::MAX.get() as usize }>;
/// Slaves, each with the state that it has to enter.
pub type EnteringSlaves = List<(u8, AlState), SLAVES_MAX>;
/// Slaves that had to enter a state, each with that state and the result.
pub type Entered = List<(u8, AlState, Result<(), EnterError>), SLAVES_MAX>;

/// An operation of a network, one at a time. Slaves are numbered from 0.
#[allow(clippy::large_enum_variant, reason = "there is one at a time, and boxing it would allocate")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Counts the slaves, brings those that answer to Init, and reads their EEPROMs.
    Scan,
    /// Reads the states of all slaves.
    ReadStates,
    /// Brings each of these slaves to a state.
    Enter(EnteringSlaves),
    /// Reads an object: SDO upload.
    Read {
        /// The slave whose object is read.
        slave: u8,
        /// The object to read.
        object: ObjectAddress,
        /// One entry, or all of them (complete access).
        scope: SdoScope,
        /// The maximum number of bytes to return.
        room: usize,
        /// The timeout for each answer of the slave.
        timeout_ns: Ns,
    },
    /// Writes an object: SDO download.
    Write {
        /// The slave whose object is written.
        slave: u8,
        /// The object to write.
        object: ObjectAddress,
        /// One entry, or all of them (complete access).
        scope: SdoScope,
        /// The whole value to write.
        value: SdoData,
        /// The timeout for each answer of the slave.
        timeout_ns: Ns,
    },
    /// Sends a datagram that the host has composed, and returns it as it comes back.
    Datagram {
        /// The datagram's EtherCAT command.
        command: Command,
        /// The datagram's address, as in [`DatagramHeader::address`](crate::ethercat::DatagramHeader::address).
        address: u32,
        /// The datagram's data.
        data: Vec<u8>,
    },
    /// Reads words of an EEPROM.
    ReadEeprom {
        /// The slave whose EEPROM is read.
        slave: u8,
        /// The address of the first word.
        word: u16,
        /// The number of words.
        count: usize,
    },
    /// Writes a word of an EEPROM.
    WriteEeprom {
        /// The slave whose EEPROM is written.
        slave: u8,
        /// The address of the word.
        word: u16,
        /// The new value.
        value: u16,
    },
    /// Sets a sync manager to other values than those in the EEPROM, at once and in every later configuration of the slave.
    SetManager {
        /// The slave with the sync manager.
        slave: u8,
        /// The number of the sync manager.
        number: u8,
        /// The content of the sync manager's registers.
        registers: SyncManager,
    },
    /// Reads a file from a slave (FoE).
    ReadFile {
        /// The slave whose file is read.
        slave: u8,
        /// The file's name.
        name: Vec<u8>,
        /// The file's password.
        password: u32,
        /// The timeout for each packet of the slave.
        timeout_ns: Ns,
    },
    /// Writes a file to a slave (FoE).
    WriteFile {
        /// The slave whose file is written.
        slave: u8,
        /// The file's name.
        name: Vec<u8>,
        /// The file's password.
        password: u32,
        /// The file's content.
        content: Vec<u8>,
        /// The timeout for each packet of the slave.
        timeout_ns: Ns,
    },
    /// Reads the message in the mailbox of a slave.
    ReceiveMail {
        /// The slave whose mailbox is read.
        slave: u8,
    },
}

/// The answer of a network. Each variant names the [`Operation`] that it answers.
#[allow(clippy::large_enum_variant, reason = "there is one at a time, and boxing it would allocate")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OperationAnswer {
    /// [`Operation::Scan`]: the number of slaves found, at most [`SLAVES_MAX`].
    Scanned(u8),
    /// [`Operation::ReadStates`]: the states were read.
    StatesRead,
    /// [`Operation::Enter`]: the result for each slave.
    Entered(Entered),
    /// [`Operation::Read`]: as much of the value as there is room for, and its full length; or the abort code,
    /// [`AbortCode::TIMEOUT`] if the slave does not answer.
    Value(Result<(SdoData, usize), AbortCode>),
    /// [`Operation::Write`]: nothing, or the abort code as for [`Self::Value`].
    Written(Result<(), AbortCode>),
    /// [`Operation::Datagram`]: data and working counter; `None` if the datagram did not come back.
    Datagram(Option<(Vec<u8>, u16)>),
    /// [`Operation::ReadEeprom`]: the words that were read; [`Operation::WriteEeprom`]: no words.
    Eeprom(Result<Vec<u16>, EepromFailure>),
    /// [`Operation::SetManager`]: whether the slave has accepted the registers.
    ManagerSet(bool),
    /// [`Operation::ReadFile`]: the content that was read; [`Operation::WriteFile`]: no content. Or the FoE error code;
    /// [`AbortCode::TIMEOUT`], which is no FoE error code, if the slave does not answer.
    File(Result<Vec<u8>, u32>),
    /// [`Operation::ReceiveMail`]: the message from the mailbox; `None` if there is none, or if the slave does not
    /// answer.
    Mail(Option<Vec<u8>>),
    /// The network does not support the operation.
    Unknown,
}

/// Why an access to an EEPROM failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EepromFailure {
    /// The slave does not answer.
    NoAnswer,
    /// The EEPROM was busy for too long, or another job of the master prevents the access: a change of the slave's
    /// state or another access to its EEPROM.
    Busy,
    /// The EEPROM refuses the command.
    CommandRefused,
}
