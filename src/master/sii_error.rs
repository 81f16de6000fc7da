//! Faults of an EEPROM: why it was not read, or what is wrong with its content.

use crate::ethercat::Ns;
use crate::ethercat::registers::SiiControl;
use crate::ethercat::sii::{SII_INFO_LEN, Sii};

/// How long an EEPROM command may take, as in TwinCAT: the controllers of some slaves emulate the EEPROM in flash
/// memory.
pub(super) const BUSY_MAX_NS: Ns = 100_000_000;

/// Why an EEPROM was not read, or what is wrong with its content.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SiiError {
    /// The slave did not answer.
    #[error("the slave did not answer while its EEPROM was accessed; check its cable and its power")]
    NoAnswer,
    /// A command took longer than 100 ms.
    #[error("the EEPROM is busy for more than {} ms; the slave's own controller may have kept it", BUSY_MAX_NS / 1_000_000)]
    Busy,
    /// The EEPROM reports an error.
    #[error("the EEPROM reports an error, status 0x{:04X}", .0.0)]
    Command(SiiControl),
    /// The EEPROM was never written.
    #[error("the EEPROM is empty: all of its first 64 words are 0x{0:02X}{0:02X}")]
    Empty(u8),
    /// The checksum is wrong, so that the slave controller loads nothing from the EEPROM.
    #[error(
        "the checksum of the EEPROM's first words is 0x{found:02X} and should be 0x{expected:02X}: the slave \
         controller does not load it"
    )]
    Checksum {
        /// The checksum in the EEPROM.
        found: u8,
        /// The checksum that the first words should have.
        expected: u8,
    },
    /// The end of the categories is missing.
    #[error("the EEPROM's categories are not whole: nothing after word 0x{word:04X} can be read")]
    NoEnd {
        /// The number of the word at which the last complete category ends, from the beginning of the EEPROM.
        word: u16,
    },
    /// The scan found no slave with that number.
    #[error("there is no slave {0}; the scan found fewer")]
    NoSlave(u8),
    /// The EEPROM is being accessed, or the slave is changing its state, which may need the EEPROM.
    #[error("the EEPROM of slave {0} is in use, or its state is being changed; wait until that has ended")]
    InUse(u8),
    /// The words would extend beyond the last address.
    #[error("the words end behind word 0xFFFF; ask for fewer")]
    TooLong,
}

/// What is wrong with the content of an EEPROM. The master works with such an EEPROM; this is for the tools, which
/// report it.
pub(crate) fn fault(content: &[u8]) -> Option<SiiError> {
    let sii = Sii::new(content).ok()?;
    if let Some(byte) = sii.blank() {
        return Some(SiiError::Empty(byte));
    }
    if !sii.has_right_checksum() {
        let (found, expected) = sii.checksums();
        return Some(SiiError::Checksum { found, expected });
    }
    let whole: usize = sii.categories().map_while(Result::ok).map(|category| 2 + category.data.len() / 2).sum();
    let word = u16::try_from(SII_INFO_LEN / 2 + whole).unwrap_or(u16::MAX);
    // Content that ends exactly after a category needs no end mark.
    let is_cut = Sii::lacks(content) != Ok(0) && content.len() > 2 * usize::from(word);
    is_cut.then_some(SiiError::NoEnd { word })
}
