//! Which chip and firmware the model is: what differs between them.

use crate::xf::request::PdoConfigForm;
use crate::xf::response::{FirmwareIdentity, Series};
use crate::xf::{Coverage, Coverages, DataSize};

/// A chip with its firmware. Start from one of the constants and change what is to be different.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    /// The version that FW_VERSION_GET returns.
    pub version: u8,
    /// What newer firmware adds to that answer (XF EN 1285); older has none (XF ZH 1208).
    pub identity: Option<FirmwareIdentity>,
    /// The size of the data segment after a start.
    pub size: DataSize,
    /// The size cannot be changed: an ECM-XFU (XF EN 715).
    pub size_is_fixed: bool,
    /// What a CRC-32 covers in each direction.
    pub coverages: Coverages,
    /// How many PDOs PDO_CONFIG_GET answers with.
    pub pdo_config: PdoConfigForm,
}

impl Profile {
    /// The chip of the manuals' first editions: n is 112, FW_VERSION_GET has no data, and nothing is known of LRW.
    ///
    /// `[OURS]` Version 0x0E: it has the functions of firmware 9, but drives GPIO 12 to 15 by command 32 alone.
    pub const OLD: Self = Self {
        version: 0x0E,
        identity: None,
        size: DataSize::MANUAL,
        size_is_fixed: false,
        coverages: Coverages { commands: Coverage::All, answers: Coverage::All },
        pdo_config: PdoConfigForm::Three,
    };

    /// A newer chip: n is 1024, firmware 0x22, which knows LRW and the reference clock in ECAT_INIT_OP.
    ///
    /// `[OURS]` The identification is all 0, and the series 0, since the manual gives them no numbers.
    pub const NEW: Self = Self {
        version: 0x22,
        identity: Some(FirmwareIdentity { extended: 0, series: Series(0), identification: [0; 16] }),
        size: DataSize::NEWER,
        pdo_config: PdoConfigForm::Four,
        ..Self::OLD
    };

    /// An ECM-XFU: as [`Self::NEW`] with n always 992.
    pub const XFU: Self = Self { size: DataSize::XFU, size_is_fixed: true, ..Self::NEW };

    /// Whether the firmware knows LRW and the reference clock: 0x22 and later (XF EN 375).
    pub const fn is_newer(&self) -> bool {
        self.version >= 0x22
    }

    /// Whether the CiA 402 helper has defaults, so that 402_CTL_SET needs no 402_CONFIG_SET before: the vendor's driver of the first
    /// chips sends none (OBS). `[OURS]` Firmware before 0x22, since the manual of the newer one demands it (XF EN 795).
    pub const fn has_helper_defaults(&self) -> bool {
        !self.is_newer()
    }

    /// Whether GPIO 12 to 15 can be driven by the header, 12 and 13 in each other's place: 0x1E and later (XF ZH 246).
    pub const fn has_wide_header_outputs(&self) -> bool {
        self.version >= 0x1E
    }
}
