//! Mailbox services that this crate's own master handles, whether it or a chip runs the network: SDO information and
//! FoE.

use super::{BusError, Network};
use crate::ethercat::Ns;
use crate::ethercat::coe::{AbortCode, EntryRequest, ObjectListType};
use crate::ethercat::registers::AL_STATUS;
use crate::ethercat::sii::{CoeDetails, MailboxProtocols};
use crate::master::{Ending, FileError, Job, MailboxInfo, Master, SdoError};

/// \[OURS] Timeout for each answer of a slave's mailbox.
pub(super) const ANSWER_MAX_NS: Ns = 5_000_000_000;

/// A network whose mailboxes this crate's own master can use: it runs the network itself, or has joined the network of
/// a chip.
pub(super) trait Mailboxes: Network {
    /// The mailbox of a slave as its EEPROM describes it; `None` if it has none.
    ///
    /// # Errors
    /// [`BusError::NoSuchSlave`], or the EEPROM cannot be read.
    fn mailbox(&mut self, slave: u8) -> Result<Option<MailboxInfo>, BusError>;

    /// Starts a job of this crate's own master with `start` and waits until it ends. `start` gets the number that the
    /// slave has in this master, which differs from `slave` behind a chip.
    ///
    /// # Errors
    /// The network card is gone, or the chip cannot be reached.
    fn run<T: Ending>(&mut self, slave: u8, start: impl FnOnce(&mut Master, u8) -> Job<T>) -> Result<T, BusError>;
}

/// Checks that a slave's mailbox supports a protocol, and brings the slave to PreOP, where its mailbox works.
///
/// Returns `without` if the slave has no mailbox, or one that does not support this protocol. Also returns the errors
/// of [`Mailboxes::mailbox`] and [`Network::bring_to_preop`].
pub(super) fn open(
    network: &mut impl Mailboxes,
    slave: u8,
    protocol: MailboxProtocols,
    without: BusError,
) -> Result<MailboxInfo, BusError> {
    let mailbox = network.mailbox(slave)?.filter(|mailbox| mailbox.protocols.contains(protocol)).ok_or(without)?;
    network.bring_to_preop(slave)?;
    Ok(mailbox)
}

/// Brings a slave to PreOP. Returns whether its EEPROM declares the SDO information service. A slave may have the
/// service although its EEPROM does not declare it; only the answer to a request shows that.
fn open_information(network: &mut impl Mailboxes, slave: u8) -> Result<bool, BusError> {
    let mailbox = open(network, slave, MailboxProtocols::COE, BusError::NoCoe { slave })?;
    Ok(mailbox.coe.contains(CoeDetails::SDO_INFO))
}

/// [`Network::object_list`] by the SDO information service, for both kinds of network.
pub(super) fn object_list(network: &mut impl Mailboxes, slave: u8) -> Result<Vec<u16>, BusError> {
    let is_given = open_information(network, slave)?;
    let list = network.run(slave, |master, slave| master.object_list(slave, ObjectListType::All, ANSWER_MAX_NS))?;
    list.map_err(|error| failed_information(network, slave, is_given, error))
}

/// [`Network::describe_object`] by the SDO information service, for both kinds of network.
pub(super) fn describe_object(network: &mut impl Mailboxes, slave: u8, index: u16) -> Result<Vec<u8>, BusError> {
    describe(network, slave, |master, slave| master.describe_object(slave, index, ANSWER_MAX_NS))
}

/// [`Network::describe_entry`] by the SDO information service, for both kinds of network.
pub(super) fn describe_entry(
    network: &mut impl Mailboxes,
    slave: u8,
    request: EntryRequest,
) -> Result<Vec<u8>, BusError> {
    describe(network, slave, |master, slave| master.describe_entry(slave, request, ANSWER_MAX_NS))
}

fn describe(
    network: &mut impl Mailboxes,
    slave: u8,
    start: impl FnOnce(&mut Master, u8) -> Job<Result<Vec<u8>, SdoError>>,
) -> Result<Vec<u8>, BusError> {
    let is_given = open_information(network, slave)?;
    network.run(slave, start)?.map_err(|error| failed_information(network, slave, is_given, error))
}

/// [`Network::read_file`] by FoE, for both kinds of network.
pub(super) fn read_file(
    network: &mut impl Mailboxes,
    slave: u8,
    name: &str,
    password: u32,
) -> Result<Vec<u8>, BusError> {
    open(network, slave, MailboxProtocols::FOE, BusError::NoFoe { slave })?;
    let start = |master: &mut Master, slave| master.read_file(slave, name.as_bytes(), password, ANSWER_MAX_NS);
    network.run(slave, start)?.map_err(|error| failed_file(network, slave, name, error))
}

/// [`Network::write_file`] by FoE, for both kinds of network.
pub(super) fn write_file(
    network: &mut impl Mailboxes,
    slave: u8,
    name: &str,
    password: u32,
    content: &[u8],
) -> Result<(), BusError> {
    open(network, slave, MailboxProtocols::FOE, BusError::NoFoe { slave })?;
    let start =
        |master: &mut Master, slave| master.write_file(slave, name.as_bytes(), password, content, ANSWER_MAX_NS);
    network.run(slave, start)?.map_err(|error| failed_file(network, slave, name, error))
}

/// The error of a failed SDO information request, or [`BusError::Gone`] if the slave is gone. A slave that refuses the
/// request is taken to lack the service, unless its EEPROM declares it or the abort code says that the object does not
/// exist.
fn failed_information(network: &mut impl Mailboxes, slave: u8, is_given: bool, error: SdoError) -> BusError {
    let knows_service = matches!(error, SdoError::Abort(AbortCode::NO_OBJECT | AbortCode::NO_SUB_INDEX));
    let error = if is_given || knows_service {
        BusError::Information { slave, error }
    } else {
        BusError::NoInformation { slave }
    };
    unless_gone(network, slave, error)
}

fn failed_file(network: &mut impl Mailboxes, slave: u8, name: &str, error: FileError) -> BusError {
    unless_gone(network, slave, BusError::File { slave, name: name.to_owned(), error })
}

/// Finds the cause of a failed mailbox request. Returns `error` if the slave has refused the request, or still answers a
/// read of its AL status. If it does not answer, returns that the slave, or the network card, is gone.
pub(super) fn unless_gone(network: &mut impl Mailboxes, slave: u8, error: BusError) -> BusError {
    let is_refusal = match &error {
        BusError::Sdo { error, .. } | BusError::Information { error, .. } => matches!(error, SdoError::Abort(_)),
        BusError::File { error, .. } => matches!(error, FileError::File(_)),
        _ => false,
    };
    if is_refusal {
        return error;
    }
    match network.read(slave, AL_STATUS, &mut [0; 2]) {
        Ok(()) => error,
        Err(gone @ BusError::CardGone { .. }) => gone,
        Err(_) => BusError::Gone { slave },
    }
}
