//! A HID pipe on USB: reports of a fixed size, one endpoint each way, over libusb.
//!
//! [`find`] tells a device that has the wanted shape from others; [`Pipe`] moves its reports. Transfers to the host are
//! always queued, so that no report is missed between two reads.

mod find;
mod pipe;
mod transfer;

pub use find::{Found, NotOne, Shape, find};
pub use pipe::{Limits, Pipe, PipeError, PipeStats};

/// Bytes of a report, both ways.
pub const REPORT_LEN: usize = 512;
