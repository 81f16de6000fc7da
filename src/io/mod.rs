//! Bytes and wires, without a word of what they mean.

#[cfg(all(feature = "usb", any(unix, windows)))]
pub mod hid;
pub mod shape;
#[cfg(all(feature = "spi", target_os = "linux"))]
pub mod spi;
