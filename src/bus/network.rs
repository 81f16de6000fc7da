//! The trait [`Network`], and the slaves that it finds.

use std::time::Duration;

use super::BusError;
use crate::ethercat::AlStatus;
use crate::ethercat::coe::{EntryRequest, ObjectAddress, SdoScope};
use crate::ethercat::registers::{AlStatusRegister, DlStatus};
use crate::ethercat::sii::{MailboxProtocols, SiiIdentity};
use crate::fieldbus::RingState;
use crate::master::{FrameCounters, Upstream};

/// The AL state of a slave, with its status code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveState {
    /// The AL status register: the state, and the error flag.
    pub status: AlStatusRegister,
    /// The AL status code: why the slave has refused or left a state; 0 if it has done neither.
    pub code: AlStatus,
}

/// A slave that a scan has found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundSlave {
    /// The number of the slave in network order, from 1.
    pub slave: u8,
    /// The station address that the slave has now.
    pub station: u16,
    /// The station alias; 0 if it has none.
    pub alias: u16,
    /// Vendor, product, revision and serial number. An ECM-XF does not report the serial number, which is 0 then.
    pub identity: SiiIdentity,
    /// The name in the slave's EEPROM; empty if there is none.
    pub name: String,
    /// The AL state in which the slave was before the scan. If an ECM-XF had to initialise its network for the scan,
    /// this is the state after the initialisation.
    pub found: SlaveState,
    /// The DL status: which ports are open and have a link.
    pub ports: DlStatus,
    /// The type of each port (MII, EBUS or none), register 0x0007. 0 if it is not known; then `ports` is not known
    /// either.
    pub port_types: u8,
    /// The slave and the port that this slave is connected to; `None` if it is connected to the master.
    pub upstream: Option<Upstream>,
    /// The port at which frames enter the slave, as the receive times of its clock show. 0 is port IN, the usual one; if
    /// the plugs IN and OUT are swapped it is another port. It is 0 also for a slave without a clock, whose entry port is
    /// not known.
    pub entry_port: u8,
    /// Whether the slave has distributed clocks.
    pub has_clock: bool,
    /// The protocols of the slave's mailbox, empty if it has no mailbox; `None` if they are not known.
    pub protocols: Option<MailboxProtocols>,
    /// The lengths of the slave's outputs and inputs, in bytes. `None` if the EEPROM does not contain a length, or if the
    /// chip has not configured the process data yet.
    pub process_bytes: (Option<u16>, Option<u16>),
    /// Why the EEPROM could not be read, or what is wrong with its content; `None` if nothing is.
    pub eeprom_error: Option<String>,
}

/// Access to the slaves of a network. Each call waits until it is done, and every wait has a timeout.
///
/// Slaves are numbered from 1 in network order. All calls except [`Network::scan`] need a slave that the scan has
/// found.
pub trait Network {
    /// Finds the slaves. If [`Network::resets_slaves`], all slaves are in Init afterwards.
    ///
    /// # Errors
    /// There is no slave, a slave does not answer, another master runs the network, or the card or the chip is gone.
    fn scan(&mut self) -> Result<Vec<FoundSlave>, BusError>;

    /// Whether the network runs in virtual time, which passes in waits alone.
    fn is_virtual(&self) -> bool;

    /// Whether a scan takes all slaves to Init. If a chip runs the network, the scan leaves them in their states.
    fn resets_slaves(&self) -> bool;

    /// The length of the longest value, bytes, that an SDO read or write transfers completely. A read of a longer value
    /// returns only its first bytes, but always more bytes than this.
    fn value_bytes_max(&self) -> usize;

    /// Waits for this time. This crate's own master keeps the slaves' distributed clocks synchronized meanwhile.
    ///
    /// # Errors
    /// [`BusError::CardGone`], or [`BusError::Chip`] if the chip cannot be reached.
    fn wait(&mut self, time: Duration) -> Result<(), BusError>;

    /// Sends long frames for this time, so that a bad cable shows in the error counters.
    ///
    /// # Errors
    /// The errors of [`Network::wait`]. Lost frames are no error.
    fn load(&mut self, time: Duration) -> Result<(), BusError>;

    /// Reads registers of a slave.
    ///
    /// # Errors
    /// [`BusError::Register`]: the slave does not answer, or answers with a wrong working counter.
    fn read(&mut self, slave: u8, address: u16, data: &mut [u8]) -> Result<(), BusError>;

    /// Writes registers of a slave.
    ///
    /// # Errors
    /// [`BusError::Register`]: the slave does not answer, or answers with a wrong working counter.
    fn write(&mut self, slave: u8, address: u16, data: &[u8]) -> Result<(), BusError>;

    /// Brings a slave from Init to PreOP, where its mailbox works. A slave in a higher state stays there.
    ///
    /// # Errors
    /// [`BusError::State`]: the slave refuses the change or does not reach PreOP in time.
    fn bring_to_preop(&mut self, slave: u8) -> Result<(), BusError>;

    /// Reads an object by SDO.
    ///
    /// # Errors
    /// [`BusError::Sdo`]: the slave aborted the transfer, or did not answer in time.
    fn upload(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope) -> Result<Vec<u8>, BusError>;

    /// Writes an object by SDO.
    ///
    /// # Errors
    /// [`BusError::Sdo`]: the slave aborted the transfer, or did not answer in time.
    fn download(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), BusError>;

    /// The indices of all objects of a slave, from its SDO information service.
    ///
    /// # Errors
    /// [`BusError::Information`]: the slave aborts the request, for example because it has no such object, or gives no valid
    /// answer. [`BusError::NoCoe`], [`BusError::NoInformation`]: it has no CoE, or no SDO information service.
    fn object_list(&mut self, slave: u8) -> Result<Vec<u16>, BusError>;

    /// The description of an object as the slave sends it: the bytes of an
    /// [`ObjectDescription`](crate::ethercat::coe::ObjectDescription), which borrows the name from them.
    ///
    /// # Errors
    /// [`BusError::Information`]: the slave aborts the request, for example because it has no such object, or gives no valid
    /// answer. [`BusError::NoCoe`], [`BusError::NoInformation`]: it has no CoE, or no SDO information service.
    fn describe_object(&mut self, slave: u8, index: u16) -> Result<Vec<u8>, BusError>;

    /// The description of a sub-index as the slave sends it: the bytes of an
    /// [`EntryDescription`](crate::ethercat::coe::EntryDescription).
    ///
    /// # Errors
    /// [`BusError::Information`]: the slave aborts the request, for example because it has no such object, or gives no valid
    /// answer. [`BusError::NoCoe`], [`BusError::NoInformation`]: it has no CoE, or no SDO information service.
    fn describe_entry(&mut self, slave: u8, request: EntryRequest) -> Result<Vec<u8>, BusError>;

    /// The content of a slave's EEPROM from its first word to the end of its categories. This crate's own master
    /// returns the content that the last scan has read.
    ///
    /// # Errors
    /// [`BusError::Eeprom`]: the EEPROM cannot be read.
    fn read_eeprom(&mut self, slave: u8) -> Result<Vec<u8>, BusError>;

    /// Reads `count` words of a slave's EEPROM, beginning at the word `first`.
    ///
    /// # Errors
    /// [`BusError::Eeprom`]: the words cannot be read.
    fn read_eeprom_words(&mut self, slave: u8, first: u16, count: usize) -> Result<Vec<u16>, BusError>;

    /// Writes words to a slave's EEPROM, beginning at the word `first`.
    ///
    /// # Errors
    /// [`BusError::Eeprom`]: the words cannot be written. [`BusError::Runs`]: a chip runs the network in SafeOP or OP.
    fn write_eeprom_words(&mut self, slave: u8, first: u16, words: &[u16]) -> Result<(), BusError>;

    /// Reads a file by FoE.
    ///
    /// # Errors
    /// [`BusError::NoFoe`]: the slave has no FoE. [`BusError::File`]: it refused the transfer, or did not answer in
    /// time.
    fn read_file(&mut self, slave: u8, name: &str, password: u32) -> Result<Vec<u8>, BusError>;

    /// Writes a file by FoE.
    ///
    /// # Errors
    /// [`BusError::NoFoe`]: the slave has no FoE. [`BusError::File`]: it refused the transfer, or did not answer in
    /// time. [`BusError::Runs`]: a chip runs the network in SafeOP or OP.
    fn write_file(&mut self, slave: u8, name: &str, password: u32, content: &[u8]) -> Result<(), BusError>;

    /// The slave with the reference clock; `None` if no slave has a clock, or if it is not known.
    fn reference_clock(&self) -> Option<u8>;

    /// The state of the ring, whose end is connected to a second network card; `None` if there is no ring.
    fn ring(&self) -> Option<RingState>;

    /// The counters of frames sent, received and lost; `None` if they are not known.
    fn frames(&self) -> Option<FrameCounters>;
}
