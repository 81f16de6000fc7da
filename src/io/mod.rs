//! Access to the hardware to which a board or its slaves are connected, without knowledge of a protocol: a HID device
//! on USB ([`hid`], feature `usb`), a device on SPI with its GPIO lines ([`spi`], feature `spi`), a network interface
//! ([`ethernet`], features `nic` and `serve`), and this machine as a device on USB (`gadget`, feature `serve`).

pub mod descriptors;
#[cfg(all(any(feature = "nic", feature = "serve"), target_os = "linux"))]
pub mod ethernet;
#[cfg(all(feature = "serve", target_os = "linux"))]
pub mod gadget;
#[cfg(all(feature = "usb", any(unix, windows)))]
pub mod hid;
#[cfg(target_os = "linux")]
pub mod routes;
#[cfg(all(feature = "spi", target_os = "linux"))]
pub mod spi;
