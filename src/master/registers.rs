//! Single datagrams that a user sends: any command to any address, and accesses to the registers of one slave.

use super::bus::{Bus, Unanswered};
use crate::ethercat::{Command, DATA_LEN_MAX};

/// Why a datagram or a register access has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DatagramError {
    /// The frame did not come back.
    #[error("the frame did not come back; check the cables")]
    Lost,
    /// The data do not fit into a datagram.
    #[error("{0} bytes do not fit into a datagram, which has room for {DATA_LEN_MAX}; ask for fewer at once")]
    TooLong(usize),
    /// The scan found no slave with that number.
    #[error("there is no slave {0}; the scan found fewer")]
    NoSlave(u8),
    /// The frame came back with another working counter than the 1 that a single slave adds.
    #[error(
        "the working counter is {0}, not 1: the slave does not answer, has no such registers, or does not allow \
         writing them now"
    )]
    WorkingCounter(u16),
}

impl From<Unanswered> for DatagramError {
    fn from(unanswered: Unanswered) -> Self {
        match unanswered {
            Unanswered::Lost => Self::Lost,
            Unanswered::Counter(counter) => Self::WorkingCounter(counter),
        }
    }
}

/// The answer to a datagram.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DatagramAnswer {
    /// The data of the answer, as many bytes as were sent.
    pub data: Vec<u8>,
    /// The working counter of the answer. It is not checked.
    pub working_counter: u16,
}

const fn check_len(bytes: usize) -> Result<(), DatagramError> {
    if bytes > DATA_LEN_MAX { Err(DatagramError::TooLong(bytes)) } else { Ok(()) }
}

/// Sends a datagram once; its answer may have any working counter.
///
/// # Errors
/// [`DatagramError::TooLong`]; [`DatagramError::Lost`] if the frame does not come back.
pub(super) async fn datagram(
    bus: Bus,
    command: Command,
    address: u32,
    mut data: Vec<u8>,
) -> Result<DatagramAnswer, DatagramError> {
    check_len(data.len())?;
    let ticket = bus.queue_with(command, address as u16, (address >> 16) as u16, &data, 1);
    match ticket.answer(&mut data).await {
        Ok(working_counter) => Ok(DatagramAnswer { data, working_counter }),
        Err(_) => Err(DatagramError::Lost),
    }
}

/// Reads registers of the slave with that station address.
///
/// # Errors
/// [`DatagramError::TooLong`]; [`DatagramError::Lost`] if no frame comes back; [`DatagramError::WorkingCounter`] if the
/// slave does not answer or refuses the access.
pub(super) async fn read(bus: Bus, station: u16, address: u16, len: usize) -> Result<Vec<u8>, DatagramError> {
    check_len(len)?;
    let mut data = vec![0; len];
    match bus.exchange(Command::Fprd, station, address, &mut data).await {
        Ok(1) => Ok(data),
        Ok(counter) => Err(DatagramError::WorkingCounter(counter)),
        Err(_) => Err(DatagramError::Lost),
    }
}

/// Writes registers of the slave with that station address.
///
/// # Errors
/// [`DatagramError::TooLong`]; [`DatagramError::Lost`] if no frame comes back; [`DatagramError::WorkingCounter`] if the
/// slave does not answer or refuses the access.
pub(super) async fn write(bus: Bus, station: u16, address: u16, data: Vec<u8>) -> Result<(), DatagramError> {
    check_len(data.len())?;
    Ok(bus.write(station, address, &data).await?)
}
