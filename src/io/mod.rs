//! Bytes and wires, without a word of what they mean.

#[cfg(feature = "usb")]
pub mod hid;
#[cfg(all(feature = "spi", target_os = "linux"))]
pub mod spi;
