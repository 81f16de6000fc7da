//! A HID pipe on USB: reports of a fixed size, one endpoint each way.
//!
//! [`find`] tells a device that has the wanted shape from others; [`Pipe`] moves its reports. Transfers to the host are
//! always queued, so that no report is missed between two reads. What moves them is a line: libusb's transfers, or on
//! Windows the system's own HID driver (docs/decisions/windows-hid-driver.md).

#[cfg(test)]
mod calls;
mod error;
mod events;
mod found;
#[cfg(unix)]
mod libusb;
mod line;
mod pipe;
mod reports;
mod rest;
mod system;
// Its functions are a table; the tests have one on every system.
#[cfg(any(windows, test))]
mod windows;

pub use error::UsbError;
pub use found::Found;
#[cfg(unix)]
use libusb::Device;
#[cfg(unix)]
pub use libusb::{Bus, NoBus, NoLibrary, find};
pub use pipe::{Limits, Pipe, PipeError, PipeStats};
pub use system::{Holder, Remark, System};
#[cfg(windows)]
use windows::Device;
#[cfg(windows)]
pub use windows::{Bus, NoBus, Shape, find};

#[cfg(unix)]
pub use super::shape::Shape;
pub use super::shape::{NotOne, REPORT_LEN};
