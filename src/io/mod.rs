//! Access to the hardware that a real board is connected by, without knowledge of the board's protocol: a HID device on USB
//! ([`hid`], features `usb`) and a device on SPI with its lines ([`spi`], feature `spi`).

pub mod descriptors;
#[cfg(all(feature = "usb", any(unix, windows)))]
pub mod hid;
#[cfg(all(feature = "spi", target_os = "linux"))]
pub mod spi;
