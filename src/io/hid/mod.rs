//! A HID pipe on USB: reports of a fixed size, one endpoint each way, over libusb.
//!
//! [`find`] tells a device that has the wanted shape from others; [`Pipe`] moves its reports. Transfers to the host are
//! always queued, so that no report is missed between two reads.

mod bus;
mod events;
#[cfg(test)]
mod fake;
mod find;
mod libusb;
mod pipe;
mod reports;
mod system;
mod transfer;

pub use bus::{Bus, NoBus};
pub use find::{Found, NotOne, Shape, find};
pub use libusb::{NoLibrary, UsbError};
pub use pipe::{Limits, Pipe, PipeError, PipeStats};
pub use system::{Holder, Remark, System};

/// Bytes of a report, both ways.
pub const REPORT_LEN: usize = 512;
