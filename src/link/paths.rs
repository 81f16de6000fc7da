//! Re-exports that give items of other folders their public paths in `link`. The folders depend on `link`, and this is
//! the only file of `link` that depends on them, so that the rest has no circular dependency.

#[cfg(feature = "sim")]
#[doc(hidden)]
pub use crate::testbed::{forget_parked, use_program_clock};

pub use crate::address::{Fraction, config, slaves, travel, uri};
#[cfg(all(feature = "spi", target_os = "linux"))]
pub use crate::hardware::spi;
#[cfg(feature = "sim")]
pub use crate::open::model;
pub use crate::open::{open, open_carrying, open_uncounted};
pub use crate::own_board::engine;
#[cfg(all(feature = "tcp", any(unix, windows)))]
/// The link `tcp:` and its protocol.
pub mod tcp {
    pub use crate::tcp::*;
}
#[cfg(feature = "sim")]
pub use crate::testbed::{control, manufacturer_objects, script, simulated_slaves};

/// The schemes and keys of links.
pub mod keys {
    pub use crate::address::keys::*;
    pub use crate::open::help;
}

/// Links to an ECM-XF itself, which is a chip and no board.
pub mod chip {
    #[cfg(all(feature = "spi", target_os = "linux"))]
    pub use crate::hardware::chip_on_spi::{ResetTimes, SpiChip};
    #[cfg(all(feature = "usb", unix))]
    pub use crate::hardware::chip_on_usb::UsbChip;
    pub use crate::link::chip_link::*;
    pub use crate::link::record::RecordedChip;
    pub use crate::open::chip::open;
    pub use crate::own_board::chip::{ChipBoard, ChipUse};
    #[cfg(feature = "sim")]
    pub use crate::testbed::chip::SimChip;
    #[cfg(feature = "sim")]
    pub use crate::testbed::chip_options::{ChipModel, ChipNetwork, ModelledChip, SimChipOptions};
}

/// The keys of links as Rust types.
pub mod options {
    pub use crate::link::common_options::CommonOptions;
    pub use crate::own_board::options::BoardOptions;
    pub use crate::recording::Clock;
    #[cfg(feature = "sim")]
    pub use crate::testbed::options::{ModelledBus, SimOptions};
}
