//! Links to real boards and chips that are connected to this machine.
//!
//! - `usb/`: `usb:`, an ECM-SK on USB
//! - `spi/`: `spi:`, an ECM-SK on SPI
//! - `chip_on_spi.rs`, `chip_on_usb.rs`: `xf-spi:` and `xf-usb:`, an ECM-XF chip without the board around it

#[cfg(all(feature = "spi", target_os = "linux"))]
pub mod chip_on_spi;
#[cfg(all(feature = "usb", unix))]
pub mod chip_on_usb;
#[cfg(all(feature = "spi", target_os = "linux"))]
pub mod spi;
#[cfg(all(feature = "usb", any(unix, windows)))]
pub(crate) mod usb;
