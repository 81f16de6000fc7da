//! Categories: the parts of an EEPROM after the fixed words, each with a type and a length.

use super::{SiiDcMode, SiiGeneral, SiiPdos, SiiStrings, SiiSyncManager};
use crate::ethercat::WireError;
use crate::ethercat::sii::FmmuUsage;
use crate::ethercat::wire_error::split;

/// The type of a category (ETG.2010).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CategoryKind {
    /// 10: texts. Other categories refer to them by number, from 1.
    Strings,
    /// 20: data types; the standard reserves this category for future use.
    DataTypes,
    /// 30: general information.
    General,
    /// 40: the use of each FMMU.
    Fmmus,
    /// 41: the sync managers.
    SyncManagers,
    /// 50: TxPDOs, for inputs.
    TxPdos,
    /// 51: RxPDOs, for outputs.
    RxPdos,
    /// 60: distributed clocks.
    DcModes,
    /// Any other type, such as a vendor-specific one. 0xFFFF ends the list and is not a category.
    Unknown(u16),
}

impl CategoryKind {
    pub(super) const END: u16 = 0xFFFF;

    /// The category type with this code in the EEPROM.
    pub const fn from_code(code: u16) -> Self {
        match code {
            10 => Self::Strings,
            20 => Self::DataTypes,
            30 => Self::General,
            40 => Self::Fmmus,
            41 => Self::SyncManagers,
            50 => Self::TxPdos,
            51 => Self::RxPdos,
            60 => Self::DcModes,
            code => Self::Unknown(code),
        }
    }

    /// The code in the EEPROM.
    pub const fn code(self) -> u16 {
        match self {
            Self::Strings => 10,
            Self::DataTypes => 20,
            Self::General => 30,
            Self::Fmmus => 40,
            Self::SyncManagers => 41,
            Self::TxPdos => 50,
            Self::RxPdos => 51,
            Self::DcModes => 60,
            Self::Unknown(code) => code,
        }
    }
}

/// A category of an EEPROM. Each method interprets the data as one kind of category; its result is meaningful only if
/// [`Self::kind`] is this kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Category<'a> {
    /// The type of the category.
    pub kind: CategoryKind,
    /// The data, an even number of bytes.
    pub data: &'a [u8],
}

impl<'a> Category<'a> {
    /// Interprets the data as texts, [`CategoryKind::Strings`].
    pub const fn strings(&self) -> SiiStrings<'a> {
        SiiStrings::new(self.data)
    }

    /// Interprets the data as general information, [`CategoryKind::General`].
    ///
    /// # Errors
    /// [`WireError::Short`]: the data have fewer than 18 bytes.
    pub fn general(&self) -> Result<SiiGeneral, WireError> {
        SiiGeneral::decode(self.data)
    }

    /// Interprets the data as the use of each FMMU, [`CategoryKind::Fmmus`].
    pub fn fmmus(&self) -> impl Iterator<Item = FmmuUsage> + 'a {
        self.data.iter().map(|code| FmmuUsage::from_code(*code))
    }

    /// Interprets the data as sync managers, [`CategoryKind::SyncManagers`]. A remainder of fewer than 8 bytes is ignored.
    pub fn sync_managers(&self) -> impl Iterator<Item = SiiSyncManager> + use<'a> {
        self.data.as_chunks().0.iter().map(SiiSyncManager::decode)
    }

    /// Interprets the data as PDOs, [`CategoryKind::TxPdos`] or [`CategoryKind::RxPdos`]. If decoding fails, the error is
    /// the last item.
    pub const fn pdos(&self) -> SiiPdos<'a> {
        SiiPdos::new(self.data)
    }

    /// Interprets the data as modes of distributed clocks, [`CategoryKind::DcModes`]. A remainder of fewer than 24 bytes is
    /// ignored.
    pub fn dc_modes(&self) -> impl Iterator<Item = SiiDcMode> + 'a {
        self.data.as_chunks().0.iter().map(SiiDcMode::decode)
    }
}

/// Iterator over the categories of an EEPROM. If decoding fails, the error is the last item.
#[derive(Clone, Debug)]
pub struct Categories<'a> {
    rest: Option<&'a [u8]>,
}

impl<'a> Categories<'a> {
    pub(super) const fn new(bytes: &'a [u8]) -> Self {
        Self { rest: Some(bytes) }
    }

    fn split(rest: &'a [u8]) -> Result<Option<(Category<'a>, &'a [u8])>, WireError> {
        let (kind, rest) = split::<2>(rest, "type of a category")?;
        let code = u16::from_le_bytes(*kind);
        if code == CategoryKind::END {
            return Ok(None);
        }
        let (words, rest) = split::<2>(rest, "length of a category")?;
        let needed = 2 * usize::from(u16::from_le_bytes(*words));
        let short = WireError::Short { part: "category", needed, found: rest.len() };
        let (data, rest) = rest.split_at_checked(needed).ok_or(short)?;
        Ok(Some((Category { kind: CategoryKind::from_code(code), data }, rest)))
    }
}

impl<'a> Iterator for Categories<'a> {
    type Item = Result<Category<'a>, WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        match Self::split(self.rest.take()?) {
            Ok(Some((category, rest))) => {
                self.rest = Some(rest);
                Some(Ok(category))
            }
            Ok(None) => None,
            Err(error) => Some(Err(error)),
        }
    }
}
