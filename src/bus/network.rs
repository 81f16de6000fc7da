//! A way to the slaves of a network.

use std::time::Duration;

use super::BusError;
use crate::ethercat::AlStatus;
use crate::ethercat::coe::{EntryRequest, ObjectAddress, SdoScope};
use crate::ethercat::registers::{AlStatusRegister, DlStatus};
use crate::ethercat::sii::{MailboxProtocols, SiiIdentity};
use crate::fieldbus::RingState;
use crate::master::{FrameCounters, Upstream};

/// The AL state of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveState {
    /// The state, and whether there is an error.
    pub status: AlStatusRegister,
    /// Why it is there.
    pub code: AlStatus,
}

/// A slave as a scan has found it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundSlave {
    /// Its number in the order of the cable, from 1.
    pub slave: u8,
    /// The station address that it has now.
    pub station: u16,
    /// The station alias, 0: none.
    pub alias: u16,
    /// Who it is. An ECM-XF does not tell the serial number, which is 0 then.
    pub identity: SiiIdentity,
    /// Its name; empty if it says none.
    pub name: String,
    /// Where it was before the scan.
    pub found: SlaveState,
    /// Its ports.
    pub ports: DlStatus,
    /// What its ports are made of, register 0x0007; 0: it is not known, and neither are its ports.
    pub port_types: u8,
    /// Where it is connected; `None`: at the master.
    pub upstream: Option<Upstream>,
    /// The port by which frames come to it, as its clock says: 0, unless its IN and OUT are swapped, or if it is not known.
    pub entry_port: u8,
    /// Whether it has distributed clocks.
    pub has_clock: bool,
    /// The protocols that its mailbox speaks, none if it has no mailbox; `None`: it is not known.
    pub protocols: Option<MailboxProtocols>,
    /// Bytes of its own outputs and inputs; `None`: its EEPROM does not say, or nothing is laid out behind a chip yet.
    pub process_bytes: (Option<u16>, Option<u16>),
    /// What is wrong with its EEPROM: why it was not read, or what of its content is not right; `None`: nothing is.
    pub eeprom_error: Option<String>,
}

/// A way to the slaves of a network, for one look at a time. Calls wait until they are done, and each of them ends.
///
/// Slaves are numbered from 1 in the order of the cable. All calls but [`Network::scan`] are for slaves that it has found.
pub trait Network {
    /// Finds the slaves. If [`Network::resets_slaves`], all of them are in Init then.
    ///
    /// # Errors
    /// [`BusError`]
    fn scan(&mut self) -> Result<Vec<FoundSlave>, BusError>;

    /// Whether time passes by waits alone.
    fn is_virtual(&self) -> bool;

    /// Whether a scan takes all slaves to Init. A master that is there already leaves them where they are.
    fn resets_slaves(&self) -> bool;

    /// Waits that long. Clocks are kept together meanwhile.
    ///
    /// # Errors
    /// [`BusError`]
    fn wait(&mut self, time: Duration) -> Result<(), BusError>;

    /// Lets that much time pass with long frames on the cables, so that a bad one shows.
    ///
    /// # Errors
    /// [`BusError`]
    fn load(&mut self, time: Duration) -> Result<(), BusError>;

    /// Reads registers of a slave.
    ///
    /// # Errors
    /// [`BusError::Register`]
    fn read(&mut self, slave: u8, address: u16, data: &mut [u8]) -> Result<(), BusError>;

    /// Writes registers of a slave.
    ///
    /// # Errors
    /// [`BusError::Register`]
    fn write(&mut self, slave: u8, address: u16, data: &[u8]) -> Result<(), BusError>;

    /// Brings a slave to PreOP, where its mailbox answers, unless it is there.
    ///
    /// # Errors
    /// [`BusError::State`]
    fn bring_to_preop(&mut self, slave: u8) -> Result<(), BusError>;

    /// Reads an object.
    ///
    /// # Errors
    /// [`BusError::Sdo`]
    fn upload(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope) -> Result<Vec<u8>, BusError>;

    /// Writes an object.
    ///
    /// # Errors
    /// [`BusError::Sdo`]
    fn download(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), BusError>;

    /// The indices of all objects of a slave, as it says.
    ///
    /// # Errors
    /// [`BusError::Information`]
    fn object_list(&mut self, slave: u8) -> Result<Vec<u16>, BusError>;

    /// What an object is: an [`ObjectDescription`](crate::ethercat::coe::ObjectDescription) as bytes.
    ///
    /// # Errors
    /// [`BusError::Information`]
    fn describe_object(&mut self, slave: u8, index: u16) -> Result<Vec<u8>, BusError>;

    /// What a sub-index is: an [`EntryDescription`](crate::ethercat::coe::EntryDescription) as bytes.
    ///
    /// # Errors
    /// [`BusError::Information`]
    fn describe_entry(&mut self, slave: u8, request: EntryRequest) -> Result<Vec<u8>, BusError>;

    /// The content of a slave's EEPROM from its first word to the end of its categories; with our own master as the last scan has
    /// found it.
    ///
    /// # Errors
    /// [`BusError::Eeprom`]
    fn read_eeprom(&mut self, slave: u8) -> Result<Vec<u8>, BusError>;

    /// Words of a slave's EEPROM, from that word on.
    ///
    /// # Errors
    /// [`BusError::Eeprom`]
    fn read_eeprom_words(&mut self, slave: u8, first: u16, count: usize) -> Result<Vec<u16>, BusError>;

    /// Writes words of a slave's EEPROM, from that word on.
    ///
    /// # Errors
    /// [`BusError::Eeprom`]
    fn write_eeprom_words(&mut self, slave: u8, first: u16, words: &[u16]) -> Result<(), BusError>;

    /// Reads a file by FoE.
    ///
    /// # Errors
    /// [`BusError::File`]
    fn read_file(&mut self, slave: u8, name: &str, password: u32) -> Result<Vec<u8>, BusError>;

    /// Writes a file by FoE.
    ///
    /// # Errors
    /// [`BusError::File`]
    fn write_file(&mut self, slave: u8, name: &str, password: u32, content: &[u8]) -> Result<(), BusError>;

    /// The slave with the reference clock; `None`: no slave has a clock, or it is not known.
    fn reference_clock(&self) -> Option<u8>;

    /// How the ring is in which the cables run back to a second network card; `None`: there is none.
    fn ring(&self) -> Option<RingState>;

    /// What became of the frames so far; `None`: it is not known.
    fn frames(&self) -> Option<FrameCounters>;
}
