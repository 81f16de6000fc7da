//! Writes a slave's EEPROM: checks that the new content fits the slave, and lists the words that it changes.

pub use super::content_error::ContentError;
use super::{BusError, Network};
use crate::ethercat::sii::{SII_INFO_LEN, Sii};
use crate::master::SiiError;

/// \[OURS] The maximum number of bytes that are read from an EEPROM, against a damaged list of categories that never
/// ends.
const BYTES_MAX: usize = 0x8000;

/// A word of an EEPROM that new content changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WordChange {
    /// The address of the word, counted in words of 16 bits.
    pub word: u16,
    /// The value that the EEPROM has now.
    pub from: u16,
    /// The value that is to be written.
    pub to: u16,
}

/// Checks EEPROM content by itself: its length, the checksum of its first words, and that its list of categories has an
/// end.
///
/// # Errors
/// [`ContentError::Len`]: the length is odd or too short. [`ContentError::Checksum`]: the checksum is wrong.
/// [`ContentError::Categories`]: the list of categories is damaged or has no end.
pub fn check(content: &[u8]) -> Result<(), ContentError> {
    let len = content.len();
    let sii = match Sii::new(content) {
        Ok(sii) if len.is_multiple_of(2) && len >= SII_INFO_LEN + 2 => sii,
        _ => return Err(ContentError::Len { len }),
    };
    if !sii.has_right_checksum() {
        let (found, expected) = sii.checksums();
        return Err(ContentError::Checksum { found, expected });
    }
    sii.categories().find_map(Result::err).map_or(Ok(()), |error| Err(ContentError::Categories(error)))
}

/// Checks that new content fits the slave whose EEPROM has `present` now. If `present` has a wrong checksum, any content
/// passes.
///
/// # Errors
/// [`ContentError::TooLong`]: the content is longer than the slave's EEPROM. [`ContentError::OtherDevice`]: it is for
/// another vendor or product.
pub fn check_for(content: &[u8], present: &[u8]) -> Result<(), ContentError> {
    let (Ok(wanted), Ok(found)) = (Sii::new(content), Sii::new(present)) else { return Ok(()) };
    if !found.has_right_checksum() {
        // With a wrong checksum no word of the present content can be trusted.
        return Ok(());
    }
    let (wanted, found) = (wanted.info(), found.info());
    let room = (usize::from(found.kbit_less_1) + 1) * 128;
    // Some vendors leave the word with the EEPROM's size at 0. Then the size is unknown, and the length of the content
    // is not checked.
    if found.kbit_less_1 > 0 && content.len() > room {
        return Err(ContentError::TooLong { len: content.len(), room });
    }
    let (wanted, found) = (wanted.identity, found.identity);
    let is_same = (wanted.vendor, wanted.product) == (found.vendor, found.product);
    if is_same { Ok(()) } else { Err(ContentError::OtherDevice { wanted, found }) }
}

/// Reads an EEPROM up to the end of its categories. If the list of categories is damaged, returns the bytes before the
/// damage.
///
/// # Errors
/// [`BusError::Eeprom`]: the EEPROM cannot be read, or is blank.
pub(super) fn read_whole(network: &mut dyn Network, slave: u8) -> Result<Vec<u8>, BusError> {
    let mut content: Vec<u8> = Vec::new();
    loop {
        let lacks = match Sii::lacks(&content) {
            Ok(0) => return Ok(content),
            Ok(lacks) if content.len() + lacks <= BYTES_MAX => lacks,
            _ => return Ok(content),
        };
        if let Some(byte) = Sii::new(&content).ok().and_then(|sii| sii.blank()) {
            return Err(BusError::Eeprom { slave, error: SiiError::Empty(byte) });
        }
        let first = (content.len() / 2) as u16;
        let words = network.read_eeprom_words(slave, first, lacks.div_ceil(2))?;
        content.extend(words.into_iter().flat_map(u16::to_le_bytes));
    }
}

/// EEPROM content as 16-bit words.
fn words(content: &[u8]) -> Vec<u16> {
    content.as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)).collect()
}

/// The words of a slave's EEPROM that differ from the new content, by ascending address.
///
/// # Errors
/// [`BusError::Eeprom`]: the EEPROM cannot be read.
pub fn changes(network: &mut dyn Network, slave: u8, content: &[u8]) -> Result<Vec<WordChange>, BusError> {
    let wanted = words(content);
    let present = network.read_eeprom_words(slave, 0, wanted.len())?;
    let both = (0..).zip(present.iter().zip(&wanted));
    Ok(both
        .filter(|(_, (from, to))| from != to)
        .map(|(word, (from, to))| WordChange { word, from: *from, to: *to })
        .collect())
}

/// Writes the changed words in descending order of address, so that the configuration words at the beginning, with
/// their checksum, come last. A write that is interrupted before these words leaves the old configuration with its
/// valid checksum. Then reads all written words back. Calls `written` after each word with the number of words written
/// so far.
///
/// # Errors
/// [`BusError::Eeprom`]: a word cannot be read or written. [`BusError::NotWritten`]: a word reads back with another value than
/// was written.
pub fn write(
    network: &mut dyn Network,
    slave: u8,
    changes: &[WordChange],
    mut written: impl FnMut(usize),
) -> Result<(), BusError> {
    for (n, change) in (1..).zip(changes.iter().rev()) {
        network.write_eeprom_words(slave, change.word, &[change.to])?;
        written(n);
    }
    for WordChange { word, to, .. } in changes {
        let found = network.read_eeprom_words(slave, *word, 1)?.first().copied().unwrap_or_default();
        if found != *to {
            return Err(BusError::NotWritten { slave, word: *word, wanted: *to, found });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ethercat::sii::{SiiIdentity, SiiInfo, SiiWriter};

    fn content(bytes: usize, product: u32) -> Vec<u8> {
        let mut content = vec![0; bytes];
        let identity = SiiIdentity { vendor: 7, product, revision: 1, serial: 0 };
        let mut writer = SiiWriter::new(&mut content, &SiiInfo { identity, ..SiiInfo::default() }).expect("room");
        writer.strings(&["drive"]).expect("room");
        writer.finish();
        content
    }

    /// EEPROM content of the wrong length, with a wrong checksum, without an end, for another device, or longer than
    /// the EEPROM is refused.
    #[test]
    fn a_content_that_is_not_fit_is_refused() {
        let good = content(256, 1);
        assert_eq!(check(&good), Ok(()));
        for len in [0, 1, 127, 128, 129, 255] {
            assert_eq!(check(&good[..len]), Err(ContentError::Len { len }), "{len}");
        }
        let mut wrong = good.clone();
        wrong[8] ^= 1;
        assert!(matches!(check(&wrong), Err(ContentError::Checksum { .. })));
        assert!(matches!(check(&good[..132]), Err(ContentError::Categories(_))));
        assert_eq!(check_for(&good, &content(256, 1)), Ok(()));
        assert!(matches!(check_for(&good, &content(256, 2)), Err(ContentError::OtherDevice { .. })));
        let long = content(512, 1);
        assert_eq!(check_for(&long, &good), Err(ContentError::TooLong { len: 512, room: 256 }));
        // If the present content has a wrong checksum, neither its device nor its size can be trusted, so any content
        // passes.
        assert_eq!(check_for(&long, &wrong), Ok(()));
    }
}
