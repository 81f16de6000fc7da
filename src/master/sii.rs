//! Reading the EEPROM of a slave, up to the end of its categories.

use super::bus::{Bus, Unanswered};
use crate::ethercat::registers::{SII_ADDRESS, SII_CONFIGURATION, SII_CONTROL, SII_DATA, SiiCommand, SiiControl};
use crate::ethercat::sii::{SII_INFO_LEN, Sii};
use crate::ethercat::{Ns, WireError};

/// How long a command for an EEPROM may take (all known masters).
const BUSY_MAX_NS: Ns = 20_000_000;
/// \[OURS] How often a read is tried that the EEPROM does not acknowledge.
const TRIES: u32 = 3;
/// \[OURS] How many bytes of an EEPROM are read at most.
const BYTES_MAX: usize = 0x8000;
/// The registers from control to data, as one datagram reads them.
const READ_LEN: usize = (SII_DATA - SII_CONTROL) as usize + 8;

/// Why an EEPROM was not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SiiError {
    /// The slave did not answer.
    #[error("the slave did not answer while its EEPROM was read; check its cable and its power")]
    NoAnswer,
    /// A command took longer than 20 ms.
    #[error("the EEPROM is busy for more than 20 ms; the slave's own controller may have kept it")]
    Busy,
    /// The EEPROM reports an error.
    #[error("the EEPROM reports an error, status 0x{:04X}", .0.0)]
    Command(SiiControl),
    /// It has no fixed words, or no end.
    #[error("the EEPROM has no end of its categories within 32 KiB; it may be empty")]
    NoEnd,
}

impl From<Unanswered> for SiiError {
    fn from(_: Unanswered) -> Self {
        Self::NoAnswer
    }
}

/// Offers the EEPROM to the slave's own controller, which may need it for a change of state.
pub(super) async fn offer(bus: &Bus, station: u16, is_offered: bool) -> Result<(), Unanswered> {
    bus.write(station, SII_CONFIGURATION, &[is_offered.into()]).await
}

/// The fixed words and the categories.
///
/// # Errors
/// [`SiiError`].
pub(super) async fn read(bus: &Bus, station: u16) -> Result<Vec<u8>, SiiError> {
    let mut bytes = Vec::new();
    read_up_to(bus, station, &mut bytes, SII_INFO_LEN).await?;
    loop {
        // A category that ends early says how many bytes it lacks.
        let lacks = match error_in(&bytes) {
            None => break,
            Some(WireError::Short { needed, found, .. }) => needed.saturating_sub(found).max(1),
            Some(_) => return Err(SiiError::NoEnd),
        };
        let len = bytes.len() + lacks;
        if len > BYTES_MAX {
            return Err(SiiError::NoEnd);
        }
        read_up_to(bus, station, &mut bytes, len).await?;
    }
    // What was read behind the end depends on how many bytes come at once.
    while error_in(&bytes[..bytes.len() - 2]).is_none() {
        bytes.truncate(bytes.len() - 2);
    }
    Ok(bytes)
}

/// What is wrong with an EEPROM of which these bytes are known; `None`: all categories and their end are there.
fn error_in(bytes: &[u8]) -> Option<WireError> {
    Sii::new(bytes).map_or_else(Some, |sii| sii.categories().find_map(Result::err))
}

/// Reads on until there are `len` bytes.
pub(super) async fn read_up_to(bus: &Bus, station: u16, bytes: &mut Vec<u8>, len: usize) -> Result<(), SiiError> {
    while bytes.len() < len {
        let word = (bytes.len() / 2) as u16;
        let (data, count) = read_words(bus, station, word).await?;
        bytes.extend_from_slice(&data[..count]);
    }
    Ok(())
}

/// The bytes from a word on, and how many they are: 4 or 8.
async fn read_words(bus: &Bus, station: u16, word: u16) -> Result<([u8; 8], usize), SiiError> {
    let mut status = SiiControl::NONE;
    for _ in 0..TRIES {
        let command = SiiControl::NONE.with_command(SiiCommand::Read).0.to_le_bytes();
        let [low, high] = word.to_le_bytes();
        let [c0, c1] = command;
        let until = bus.now() + BUSY_MAX_NS;
        if bus.write(station, SII_CONTROL, &[c0, c1, low, high, 0, 0]).await == Err(Unanswered::Lost) {
            return Err(SiiError::NoAnswer);
        }
        loop {
            let read = bus.read::<READ_LEN>(station, SII_CONTROL).await?;
            let [control @ .., _, _, _, _, _, _, _, _] = &read;
            status = SiiControl(u16::from_le_bytes([control[0], control[1]]));
            if !status.contains(SiiControl::BUSY) {
                let data = read.last_chunk().copied().unwrap_or_default();
                if !status.intersects(SiiControl::COMMAND_ERROR) {
                    return Ok((data, if status.contains(SiiControl::READS_8_BYTES) { 8 } else { 4 }));
                }
                break;
            }
            if bus.now() >= until {
                return Err(SiiError::Busy);
            }
        }
    }
    Err(SiiError::Command(status))
}

const _: () = assert!(SII_ADDRESS == SII_CONTROL + 2 && SII_DATA == SII_ADDRESS + 4);
