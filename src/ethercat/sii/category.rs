//! Categories: parts of an EEPROM with a type and a length each.

use super::{SiiDcMode, SiiGeneral, SiiPdos, SiiStrings, SiiSyncManager};
use crate::ethercat::WireError;
use crate::ethercat::sii::FmmuUsage;
use crate::ethercat::wire_error::split;

/// What a category holds (ETG.2010).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CategoryKind {
    /// 10: texts, to which others refer by their numbers from 1.
    Strings,
    /// 20: data types.
    DataTypes,
    /// 30: general information.
    General,
    /// 40: what the FMMUs are for.
    Fmmus,
    /// 41: the sync managers.
    SyncManagers,
    /// 50: PDOs for inputs.
    TxPdos,
    /// 51: PDOs for outputs.
    RxPdos,
    /// 60: distributed clocks.
    DcModes,
    /// Another one, e.g. a vendor's own. 0xFFFF ends the list and is no category.
    Unknown(u16),
}

impl CategoryKind {
    pub(super) const END: u16 = 0xFFFF;

    /// The kind with that code.
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

/// A category. The methods read its data as what its kind says; for another kind they give whatever comes out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Category<'a> {
    /// What it holds.
    pub kind: CategoryKind,
    /// Its data, an even number of bytes.
    pub data: &'a [u8],
}

impl<'a> Category<'a> {
    /// The texts of [`CategoryKind::Strings`].
    pub const fn strings(&self) -> SiiStrings<'a> {
        SiiStrings::new(self.data)
    }

    /// [`CategoryKind::General`].
    ///
    /// # Errors
    /// [`WireError::Short`]: it has less than 18 bytes.
    pub fn general(&self) -> Result<SiiGeneral, WireError> {
        SiiGeneral::decode(self.data)
    }

    /// What the FMMUs of [`CategoryKind::Fmmus`] are for.
    pub fn fmmus(&self) -> impl Iterator<Item = FmmuUsage> + 'a {
        self.data.iter().map(|code| FmmuUsage::from_code(*code))
    }

    /// The sync managers of [`CategoryKind::SyncManagers`]; a rest of less than 8 bytes is left out.
    pub fn sync_managers(&self) -> impl Iterator<Item = SiiSyncManager> + use<'a> {
        self.data.as_chunks().0.iter().map(SiiSyncManager::decode)
    }

    /// The PDOs of [`CategoryKind::TxPdos`] and [`CategoryKind::RxPdos`]; an error is the last item.
    pub const fn pdos(&self) -> SiiPdos<'a> {
        SiiPdos::new(self.data)
    }

    /// The modes of [`CategoryKind::DcModes`]; a rest of less than 24 bytes is left out.
    pub fn dc_modes(&self) -> impl Iterator<Item = SiiDcMode> + 'a {
        self.data.as_chunks().0.iter().map(SiiDcMode::decode)
    }
}

/// The categories of an EEPROM; an error is the last item.
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
