//! The slave information interface (SII): decoding and encoding of a slave's EEPROM.
//!
//! The first 64 words have a fixed layout: [`SiiInfo`]. Categories follow, each with a type and a length: [`Category`].
//! Addresses count 16-bit words, as masters do.
//!
//! Source: ETG.1000.6 5.4, ETG.2010; rules ECAT-3.

mod category;
mod info;
mod pdo;
mod records;
mod strings;
mod writer;

pub use category::{Categories, Category, CategoryKind};
pub use info::{MailboxArea, MailboxAreas, MailboxProtocols, SiiIdentity, SiiInfo};
pub use pdo::{SiiPdo, SiiPdoEntries, SiiPdoEntry, SiiPdos};
pub use records::{
    CoeDetails, FmmuUsage, SiiDcMode, SiiGeneral, SiiGeneralFlags, SiiSmEnable, SiiSmType, SiiSyncManager,
};
pub use strings::{SiiStrings, SiiText};
pub use writer::SiiWriter;

use super::WireError;
use super::wire_error::split;
use crc::{Algorithm, Crc, Table};

/// Word address of the station alias.
pub const ALIAS_WORD: u16 = 0x04;
/// Word address of the checksum.
pub const CHECKSUM_WORD: u16 = 0x07;
/// Word address of the vendor ID. Product code, revision and serial number follow, two words each.
pub const VENDOR_WORD: u16 = 0x08;
/// Word address of the mailbox areas in Boot.
pub const BOOT_MAILBOX_WORD: u16 = 0x14;
/// Word address of the mailbox areas in all other states.
pub const MAILBOX_WORD: u16 = 0x18;
/// Word address of the first category.
pub const CATEGORIES_WORD: u16 = 0x40;
/// Length in bytes of the part with a fixed layout.
pub const SII_INFO_LEN: usize = 2 * CATEGORIES_WORD as usize;
/// The number of bytes that the checksum covers, from the beginning of the EEPROM. The checksum follows them.
pub const CHECKED_LEN: usize = 2 * CHECKSUM_WORD as usize;

/// A value of word 7 that switches the check of the checksum off: a controller accepts it with any content (data sheets
/// of slave controllers).
pub const UNCHECKED: u16 = 0x88A4;

/// CRC-8 with polynomial 0x07 and initial value 0xFF; check value 0xFB.
const ALGORITHM: Algorithm<u8> =
    Algorithm { width: 8, poly: 0x07, init: 0xFF, refin: false, refout: false, xorout: 0, check: 0xFB, residue: 0 };
const CRC: Crc<u8, Table<1>> = Crc::<u8, Table<1>>::new(&ALGORITHM);

/// The checksum of the first 14 bytes. The EEPROM holds it in the lower byte of word 7.
pub const fn checksum(first: &[u8; CHECKED_LEN]) -> u8 {
    CRC.checksum(first)
}

/// A view of the content of an EEPROM.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sii<'a> {
    bytes: &'a [u8],
    fixed: &'a [u8; SII_INFO_LEN],
}

impl<'a> Sii<'a> {
    /// A view of the content of an EEPROM. The checksum is not verified.
    ///
    /// # Errors
    /// [`WireError::Short`]: `bytes` have fewer than 64 words, the part with a fixed layout.
    pub fn new(bytes: &'a [u8]) -> Result<Self, WireError> {
        Ok(Self { bytes, fixed: split(bytes, "SII")?.0 })
    }

    /// The minimum number of bytes that still have to be read from an EEPROM after `bytes` were read from its
    /// beginning. More may be missing, since each category gives only its own length. 0: all categories and the end
    /// marker are complete.
    ///
    /// # Errors
    /// A [`WireError`] if the bytes cannot be the beginning of a valid EEPROM.
    pub fn lacks(bytes: &[u8]) -> Result<usize, WireError> {
        match Sii::new(bytes).map_or_else(Some, |sii| sii.categories().find_map(Result::err)) {
            None => Ok(0),
            Some(WireError::Short { needed, found, .. }) => Ok(needed.saturating_sub(found).max(1)),
            Some(error) => Err(error),
        }
    }

    /// The first 64 words.
    pub fn info(&self) -> SiiInfo {
        SiiInfo::decode(self.fixed)
    }

    /// The checksum in the EEPROM, and the checksum computed over the first 14 bytes.
    pub fn checksums(&self) -> (u8, u8) {
        let first = self.fixed.first_chunk().map_or(0, checksum);
        (self.fixed[CHECKED_LEN], first)
    }

    /// Whether a slave controller accepts the checksum in the EEPROM: it is right, or word 7 is [`UNCHECKED`].
    pub fn has_right_checksum(&self) -> bool {
        let (found, expected) = self.checksums();
        found == expected || self.fixed[CHECKED_LEN..].first_chunk() == Some(&UNCHECKED.to_le_bytes())
    }

    /// The value of the bytes in an EEPROM that has never been written: all bytes of the first 64 words are 0, or all
    /// are 0xFF. `None` for a written EEPROM.
    pub fn blank(&self) -> Option<u8> {
        let [first, ..] = *self.fixed;
        (matches!(first, 0 | 0xFF) && self.fixed.iter().all(|byte| *byte == first)).then_some(first)
    }

    /// Iterates over the categories. If decoding fails, the error is the last item.
    pub fn categories(&self) -> Categories<'a> {
        Categories::new(&self.bytes[SII_INFO_LEN..])
    }

    /// The first category of a kind; `None` if there is none before the end marker, or before a category that cannot be
    /// decoded.
    pub fn category(&self, kind: CategoryKind) -> Option<Category<'a>> {
        self.all_of(kind).next()
    }

    /// All categories of a kind, up to the end marker or a category that cannot be decoded. A vendor may split the
    /// content of one category into several.
    pub fn all_of(&self, kind: CategoryKind) -> impl Iterator<Item = Category<'a>> + use<'a> {
        self.categories().map_while(Result::ok).filter(move |category| category.kind == kind)
    }

    /// The sync managers of all categories with sync managers, beginning with sync manager 0.
    pub fn sync_managers(&self) -> impl Iterator<Item = SiiSyncManager> + use<'a> {
        self.all_of(CategoryKind::SyncManagers).flat_map(|category| category.sync_managers())
    }

    /// The texts of all categories with texts, beginning with number 1.
    pub fn texts(&self) -> impl Iterator<Item = SiiText<'a>> + use<'a> {
        self.all_of(CategoryKind::Strings).flat_map(|category| category.strings().iter()).map(SiiText)
    }

    /// The text with the given number, by which other categories refer to it. `None` for number 0, which means "no
    /// text", and for a number without a text.
    pub fn text(&self, number: u8) -> Option<SiiText<'a>> {
        self.texts().nth(usize::from(number).checked_sub(1)?)
    }
}
