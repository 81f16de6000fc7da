//! The EEPROM of a slave: reading its content up to the end of the categories, reading and writing single words.

use super::bus::{Bus, Unanswered};
use super::sii_error::{BUSY_MAX_NS, SiiError};
use crate::ethercat::Ns;
use crate::ethercat::registers::{SII_ADDRESS, SII_CONFIGURATION, SII_CONTROL, SII_DATA, SiiCommand, SiiControl};
use crate::ethercat::sii::{SII_INFO_LEN, Sii, SiiIdentity, SiiInfo, VENDOR_WORD};

/// \[OURS] How long a command without acknowledgement is repeated. An EEPROM that is storing a written word
/// acknowledges nothing, and this may take as long as any command.
const SILENT_MAX_NS: Ns = BUSY_MAX_NS;
/// \[OURS] The pause before a command without acknowledgement is repeated, about the time in which an EEPROM stores a
/// word.
const AGAIN_NS: Ns = 5_000_000;
/// \[OURS] The most bytes that are read of an EEPROM.
const BYTES_MAX: usize = 0x8000;
/// The length of the registers of the EEPROM interface from control to data, bytes, which one datagram reads.
const READ_LEN: usize = (SII_DATA - SII_CONTROL) as usize + 8;

impl From<Unanswered> for SiiError {
    fn from(_: Unanswered) -> Self {
        Self::NoAnswer
    }
}

/// Gives the EEPROM to the slave's own controller, which may need it for a change of state, or takes it back.
pub(super) async fn offer(bus: &Bus, station: u16, is_offered: bool) -> Result<(), Unanswered> {
    bus.write(station, SII_CONFIGURATION, &[is_offered.into()]).await
}

/// Reads the fixed words and the categories, as far as they are complete. If the categories have no end mark, all
/// complete ones count, and [`fault`](super::sii_error::fault) reports the missing mark.
///
/// # Errors
/// [`SiiError::NoAnswer`], [`SiiError::Busy`], [`SiiError::Command`] if not even the fixed words can be read,
/// [`SiiError::Empty`] if the EEPROM was never written.
pub(super) async fn read(bus: &Bus, station: u16) -> Result<Vec<u8>, SiiError> {
    let mut bytes = Vec::new();
    read_up_to(bus, station, &mut bytes, SII_INFO_LEN).await?;
    if let Some(byte) = Sii::new(&bytes).ok().and_then(|sii| sii.blank()) {
        return Err(SiiError::Empty(byte));
    }
    loop {
        let lacks = match Sii::lacks(&bytes) {
            Ok(0) => break,
            Ok(lacks) if bytes.len() + lacks <= BYTES_MAX => lacks,
            _ => return Ok(bytes),
        };
        let len = bytes.len() + lacks;
        match read_up_to(bus, station, &mut bytes, len).await {
            Ok(()) => {
                if let Some(size) = wraps_at(&bytes) {
                    bytes.truncate(size);
                    return Ok(bytes);
                }
            }
            // The EEPROM has ended: addresses beyond its end are not acknowledged. What was read until here counts.
            Err(SiiError::Command(_)) => return Ok(bytes),
            Err(error) => return Err(error),
        }
    }
    // Bytes that were read after the end marker of the categories are cut off. Their number depends on the bytes per
    // read, 4 or 8.
    while Sii::lacks(&bytes[..bytes.len() - 2]) == Ok(0) {
        bytes.truncate(bytes.len() - 2);
    }
    Ok(bytes)
}

/// For content without an end of the categories: the size after which the content repeats, because the EEPROM ignores
/// higher address bits; `None` if it does not repeat.
fn wraps_at(bytes: &[u8]) -> Option<usize> {
    let is_again = |size: &usize| bytes.get(*size..).is_some_and(|behind| behind.starts_with(&bytes[..SII_INFO_LEN]));
    std::iter::successors(Some(SII_INFO_LEN), |size| Some(2 * size))
        .take_while(|size| *size < bytes.len())
        .find(is_again)
}

/// Reads vendor, product, revision and serial number of a slave from its EEPROM.
///
/// # Errors
/// [`SiiError::NoAnswer`], [`SiiError::Busy`], [`SiiError::Command`] if the EEPROM acknowledges no command.
pub(super) async fn identity(bus: &Bus, station: u16) -> Result<SiiIdentity, SiiError> {
    const START: usize = 2 * VENDOR_WORD as usize;
    let mut bytes = [0; SII_INFO_LEN];
    let mut at = START;
    while at < START + size_of::<SiiIdentity>() {
        let (data, count) = read_words(bus, station, (at / 2) as u16).await?;
        bytes[at..].iter_mut().zip(&data[..count]).for_each(|(to, byte)| *to = *byte);
        at += count;
    }
    // Only the identity counts: how much is read after it depends on the bytes per read, 4 or 8.
    Ok(SiiInfo::decode(&bytes).identity)
}

/// Extends `bytes` by reading until it has `len` bytes.
async fn read_up_to(bus: &Bus, station: u16, bytes: &mut Vec<u8>, len: usize) -> Result<(), SiiError> {
    while bytes.len() < len {
        let word = (bytes.len() / 2) as u16;
        let (data, count) = read_words(bus, station, word).await?;
        bytes.extend_from_slice(&data[..count]);
    }
    Ok(())
}

/// Reads the EEPROM from word `word` on, as many bytes as the slave controller reads at once. Returns the bytes and
/// their number, 4 or 8.
async fn read_words(bus: &Bus, station: u16, word: u16) -> Result<([u8; 8], usize), SiiError> {
    let (status, data) = command(bus, station, SiiControl::NONE.with_command(SiiCommand::Read), word, None).await?;
    Ok((data, if status.contains(SiiControl::READS_8_BYTES) { 8 } else { 4 }))
}

/// Writes one word of the EEPROM. The EEPROM may still be storing it when the function returns; the next command waits
/// for that.
async fn write_word(bus: &Bus, station: u16, word: u16, value: u16) -> Result<(), SiiError> {
    // The slave controller accepts a write command only if the same datagram sets the write enable bit.
    let write = SiiControl::NONE.with_command(SiiCommand::Write).with(SiiControl::WRITE_ENABLE);
    command(bus, station, write, word, Some(value)).await?;
    Ok(())
}

/// Runs a command of the EEPROM interface for the word with the address `word`, with `value` in the data register.
/// Returns the status and the data registers after it.
async fn command(
    bus: &Bus,
    station: u16,
    command: SiiControl,
    word: u16,
    value: Option<u16>,
) -> Result<(SiiControl, [u8; 8]), SiiError> {
    let (mut status, mut kept);
    let [c0, c1] = command.0.to_le_bytes();
    let [low, high] = word.to_le_bytes();
    let [d0, d1] = value.unwrap_or_default().to_le_bytes();
    let registers = [c0, c1, low, high, 0, 0, d0, d1];
    let written = if value.is_some() { &registers[..] } else { &registers[..6] };
    let silent_until = bus.now() + SILENT_MAX_NS;
    loop {
        let until = bus.now() + BUSY_MAX_NS;
        let is_taken = match bus.write(station, SII_CONTROL, written).await {
            Ok(()) => true,
            // The EEPROM interface is already running a command. If it is a command of another master, the data
            // registers would show the data of that command. If it is this command, the frame that started it was lost
            // on the way back. In both cases the command is sent again, which does no harm.
            Err(Unanswered::Counter(_)) => false,
            Err(Unanswered::Lost) => return Err(SiiError::NoAnswer),
        };
        loop {
            let read = bus.read::<READ_LEN>(station, SII_CONTROL).await?;
            let [control @ .., _, _, _, _, _, _, _, _] = &read;
            status = SiiControl(u16::from_le_bytes([control[0], control[1]]));
            if !status.contains(SiiControl::BUSY) {
                kept = !is_taken;
                let is_done = !status.intersects(SiiControl::COMMAND_ERROR | SiiControl::WRITE_ENABLE_ERROR);
                if is_taken && is_done {
                    return Ok((status, read.last_chunk().copied().unwrap_or_default()));
                }
                break;
            }
            if bus.now() >= until {
                return Err(SiiError::Busy);
            }
        }
        if bus.now() >= silent_until {
            break;
        }
        if !kept {
            bus.sleep(AGAIN_NS).await;
        }
    }
    Err(if kept { SiiError::Busy } else { SiiError::Command(status) })
}

/// Exclusive access to the EEPROM of a slave. Dropping it releases the EEPROM.
pub(super) struct Eeprom {
    bus: Bus,
    slave: u8,
    station: u16,
}

impl Drop for Eeprom {
    fn drop(&mut self) {
        self.bus.with(|shared| shared.release_eeprom(self.slave));
    }
}

impl Eeprom {
    /// Claims the EEPROM of a slave for a job, and takes it back from the slave's own controller.
    ///
    /// # Errors
    /// [`SiiError::NoSlave`]; [`SiiError::InUse`]: another job uses the EEPROM, or the slave is changing its state;
    /// [`SiiError::NoAnswer`].
    pub(super) async fn open(bus: Bus, slave: u8, station: Option<u16>) -> Result<Self, SiiError> {
        let station = station.ok_or(SiiError::NoSlave(slave))?;
        if !bus.with(|shared| shared.claim_eeprom(slave)) {
            return Err(SiiError::InUse(slave));
        }
        let eeprom = Self { bus, slave, station };
        // Takes the EEPROM back: a change of state assigns it to the slave's PDI, and a refused change may leave it
        // there.
        offer(&eeprom.bus, station, false).await?;
        Ok(eeprom)
    }

    /// Reads `count` words from the word `first` on.
    ///
    /// # Errors
    /// [`SiiError::TooLong`] beyond word 0xFFFF, [`SiiError::NoAnswer`], [`SiiError::Busy`], [`SiiError::Command`].
    pub(super) async fn read(&self, first: u16, count: usize) -> Result<Vec<u16>, SiiError> {
        check_end(first, count)?;
        let mut words: Vec<u16> = Vec::with_capacity(count);
        while words.len() < count {
            let (data, len) = read_words(&self.bus, self.station, first + words.len() as u16).await?;
            words.extend(data[..len].as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)));
        }
        words.truncate(count);
        Ok(words)
    }

    /// Writes words from the word `first` on, one after the other.
    ///
    /// # Errors
    /// [`SiiError::TooLong`] beyond word 0xFFFF: nothing is written. [`SiiError::NoAnswer`], [`SiiError::Busy`],
    /// [`SiiError::Command`]: the words before the failing one are written.
    pub(super) async fn write(&self, first: u16, words: &[u16]) -> Result<(), SiiError> {
        check_end(first, words.len())?;
        for (n, word) in (first..=u16::MAX).zip(words) {
            write_word(&self.bus, self.station, n, *word).await?;
        }
        Ok(())
    }
}

fn check_end(first: u16, count: usize) -> Result<(), SiiError> {
    if usize::from(first) + count > usize::from(u16::MAX) + 1 { Err(SiiError::TooLong) } else { Ok(()) }
}

const _: () = assert!(SII_ADDRESS == SII_CONTROL + 2 && SII_DATA == SII_ADDRESS + 4);
