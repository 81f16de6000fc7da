//! Writing an EEPROM: the fixed words, then the categories, then the end marker.

use super::{
    CategoryKind, FmmuUsage, SII_INFO_LEN, SiiDcMode, SiiGeneral, SiiInfo, SiiPdo, SiiPdoEntry, SiiSyncManager,
};
use crate::ethercat::WireError;
use crate::ethercat::wire_error::room_for;

/// Length in bytes of a category header.
const CATEGORY_HEADER_LEN: usize = 4;
/// Length in bytes of the end marker.
const END_LEN: usize = 2;

/// Writes an EEPROM into a buffer. The length of the buffer is the size of the EEPROM.
///
/// ```
/// use ecmsk::ethercat::sii::{CategoryKind, FmmuUsage, Sii, SiiInfo, SiiWriter};
///
/// let mut eeprom = [0; 2048];
/// let mut sii = SiiWriter::new(&mut eeprom, &SiiInfo { alias: 7, ..SiiInfo::default() })?;
/// sii.strings(&["Drives", "DRV1"])?;
/// sii.fmmus(&[FmmuUsage::Outputs, FmmuUsage::Inputs])?;
/// sii.finish();
///
/// let sii = Sii::new(&eeprom)?;
/// assert_eq!((sii.info().alias, sii.info().kbit_less_1, sii.has_right_checksum()), (7, 15, true));
/// let strings = sii.category(CategoryKind::Strings).expect("texts").strings();
/// assert_eq!(strings.get(2), Some(&b"DRV1"[..]));
/// # Ok::<(), ecmsk::ethercat::WireError>(())
/// ```
#[derive(Debug)]
pub struct SiiWriter<'b> {
    buffer: &'b mut [u8],
    end: usize,
}

impl<'b> SiiWriter<'b> {
    /// Begins an EEPROM with the fixed words. The writer replaces the size and the version in `info`.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the fixed words and the end marker do not fit into the buffer.
    pub fn new(buffer: &'b mut [u8], info: &SiiInfo) -> Result<Self, WireError> {
        room_for(buffer, "SII", SII_INFO_LEN + END_LEN)?;
        let kbit_less_1 = u16::try_from((buffer.len() / 128).saturating_sub(1)).unwrap_or(u16::MAX);
        let info = SiiInfo { kbit_less_1, version: 1, ..*info };
        buffer[..SII_INFO_LEN].copy_from_slice(&info.encode());
        Ok(Self { buffer, end: SII_INFO_LEN })
    }

    /// The part of the buffer for the `len` data bytes of the next category, padded to whole words. It begins after the
    /// space for the category header, which [`Self::add`] writes.
    fn place(&mut self, len: usize) -> Result<&mut [u8], WireError> {
        // After the category there must be room for the end marker.
        let padded = len.next_multiple_of(2);
        let needed = CATEGORY_HEADER_LEN + padded + END_LEN;
        let room = room_for(&mut self.buffer[self.end..], "category", needed)?;
        let place = &mut room[CATEGORY_HEADER_LEN..][..padded];
        place.fill(0);
        Ok(place)
    }

    /// Writes the header of a category whose `len` data bytes are already in the buffer, so that the next category
    /// begins after it.
    fn add(&mut self, kind: CategoryKind, len: usize) {
        let words = (len.div_ceil(2)) as u16;
        let header = &mut self.buffer[self.end..][..CATEGORY_HEADER_LEN];
        header[..2].copy_from_slice(&kind.code().to_le_bytes());
        header[2..].copy_from_slice(&words.to_le_bytes());
        self.end += CATEGORY_HEADER_LEN + 2 * usize::from(words);
    }

    /// Adds a category with these data. A byte of 0 pads an odd length.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the category does not fit.
    pub fn category(&mut self, kind: CategoryKind, data: &[u8]) -> Result<(), WireError> {
        self.place(data.len())?[..data.len()].copy_from_slice(data);
        self.add(kind, data.len());
        Ok(())
    }

    /// Adds the category of texts. Only the first 255 texts, and the first 255 bytes of each, are written.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the category does not fit.
    pub fn strings(&mut self, texts: &[&str]) -> Result<(), WireError> {
        let texts = &texts[..texts.len().min(255)];
        let len = 1 + texts.iter().map(|text| 1 + cut(text).len()).sum::<usize>();
        let place = self.place(len)?;
        place[0] = texts.len() as u8;
        let mut at = 1;
        for text in texts.iter().map(|text| cut(text)) {
            place[at] = text.len() as u8;
            place[at + 1..][..text.len()].copy_from_slice(text);
            at += 1 + text.len();
        }
        self.add(CategoryKind::Strings, len);
        Ok(())
    }

    /// Adds general information.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the category does not fit.
    pub fn general(&mut self, general: &SiiGeneral) -> Result<(), WireError> {
        self.category(CategoryKind::General, &general.encode())
    }

    /// Adds the category with the use of each FMMU.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the category does not fit.
    pub fn fmmus(&mut self, usages: &[FmmuUsage]) -> Result<(), WireError> {
        let place = self.place(usages.len())?;
        place.iter_mut().zip(usages).for_each(|(byte, usage)| *byte = usage.code());
        self.add(CategoryKind::Fmmus, usages.len());
        Ok(())
    }

    /// Adds the category of sync managers.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the category does not fit.
    pub fn sync_managers(&mut self, managers: &[SiiSyncManager]) -> Result<(), WireError> {
        let len = managers.len() * SiiSyncManager::LEN;
        let places = self.place(len)?.as_chunks_mut().0;
        places.iter_mut().zip(managers).for_each(|(place, manager)| *place = manager.encode());
        self.add(CategoryKind::SyncManagers, len);
        Ok(())
    }

    /// Adds a category of PDOs with their entries. Pass all PDOs of one direction at once, because some masters read
    /// only the first category of a kind.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the category does not fit.
    pub fn pdos(&mut self, kind: CategoryKind, pdos: &[(SiiPdo<'_>, &[SiiPdoEntry])]) -> Result<(), WireError> {
        let len_of = |entries: &[SiiPdoEntry]| SiiPdo::HEADER_LEN + entries.len().min(255) * SiiPdoEntry::LEN;
        let len = pdos.iter().map(|(_, entries)| len_of(entries)).sum();
        let mut rest = self.place(len)?;
        for (pdo, entries) in pdos {
            let written = pdo.encode(entries, rest)?;
            rest = &mut rest[written..];
        }
        self.add(kind, len);
        Ok(())
    }

    /// Adds the category of modes of distributed clocks.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the category does not fit.
    pub fn dc_modes(&mut self, modes: &[SiiDcMode]) -> Result<(), WireError> {
        let len = modes.len() * SiiDcMode::LEN;
        let places = self.place(len)?.as_chunks_mut().0;
        places.iter_mut().zip(modes).for_each(|(place, mode)| *place = mode.encode());
        self.add(CategoryKind::DcModes, len);
        Ok(())
    }

    /// Writes the end marker and fills the rest of the buffer with 0xFF, as in an erased EEPROM.
    pub fn finish(self) {
        self.buffer[self.end..].fill(0xFF);
    }
}

/// The first 255 bytes of a text: the maximum that the length byte can express.
fn cut(text: &str) -> &[u8] {
    &text.as_bytes()[..text.len().min(255)]
}
