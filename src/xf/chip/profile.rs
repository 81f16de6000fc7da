//! The types of chip and firmware that the model can be, with all differences between them.

use crate::xf::request::PdoConfigForm;
use crate::xf::response::{FirmwareIdentity, Series};
use crate::xf::{CrcCoverage, CrcCoverages, DataSize};

/// A chip with its firmware. To make another one, start from one of the constants and change fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    /// The version that FW_VERSION_GET returns.
    pub version: u8,
    /// The data that newer firmware adds to the answer of FW_VERSION_GET (XF EN 1285); older firmware adds none (XF ZH 1208).
    pub identity: Option<FirmwareIdentity>,
    /// The size of the data segment at power-on.
    pub size: DataSize,
    /// Whether the size cannot be changed, as on an ECM-XFU (XF EN 715).
    pub size_is_fixed: bool,
    /// Which bytes of a packet the CRC-32 covers, for commands and for answers.
    pub coverages: CrcCoverages,
    /// The form of PDO_CONFIG_GET's answer: with room for three PDOs or for four.
    pub pdo_config: PdoConfigForm,
}

impl Profile {
    /// The chip of the manuals' first editions: the data segment has 112 bytes, FW_VERSION_GET has no data, and LRW is
    /// not supported.
    ///
    /// `[OURS]` Version 0x0E: newer than 9, so it has the functions that the manuals mark as new in firmware 9; older than
    /// 0x1E, so GPIO 12 to 15 are driven only by command 32 and not by the header.
    pub const OLD: Self = Self {
        version: 0x0E,
        identity: None,
        size: DataSize::MANUAL,
        size_is_fixed: false,
        coverages: CrcCoverages { commands: CrcCoverage::All, answers: CrcCoverage::All },
        pdo_config: PdoConfigForm::Three,
    };

    /// A newer chip: the data segment has 1024 bytes, and firmware 0x22 supports LRW and the reference clock in
    /// ECAT_INIT_OP.
    ///
    /// `[OURS]` Identification and series in the answer of FW_VERSION_GET are 0, since the manual gives no numbers for them.
    pub const NEW: Self = Self {
        version: 0x22,
        identity: Some(FirmwareIdentity { extended: 0, series: Series(0), identification: [0; 16] }),
        size: DataSize::NEWER,
        pdo_config: PdoConfigForm::Four,
        ..Self::OLD
    };

    /// An ECM-XFU: like [`Self::NEW`], with a data segment of always 992 bytes.
    pub const XFU: Self = Self { size: DataSize::XFU, size_is_fixed: true, ..Self::NEW };

    /// Whether the firmware supports LRW and the reference clock: 0x22 and later (XF EN 375).
    pub const fn is_newer(&self) -> bool {
        self.version >= 0x22
    }

    /// Whether the CiA 402 helper has defaults, so that 402_CTL_SET works without 402_CONFIG_SET: the vendor's driver for the
    /// first chips never sends 402_CONFIG_SET (OBS). `[OURS]` This is firmware before 0x22, since the manual of the newer one
    /// demands 402_CONFIG_SET (XF EN 795).
    pub const fn has_helper_defaults(&self) -> bool {
        !self.is_newer()
    }

    /// Whether the header of a command packet can drive GPIO 12 to 15 too: firmware 0x1E and later (XF ZH 246). Bit 12 of the
    /// header is GPIO 13, and bit 13 is GPIO 12.
    pub const fn has_wide_header_outputs(&self) -> bool {
        self.version >= 0x1E
    }
}
