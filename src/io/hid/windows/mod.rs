//! USB on Windows: the system's own HID driver, as every program that talks to a HID device has it. Nothing is to be
//! installed for it (docs/decisions/windows-hid-driver.md).

mod api;
mod bus;
mod codes;
#[cfg(test)]
mod fake;
mod find;
mod handle;
mod line;
mod names;
#[cfg(test)]
mod tests;

#[cfg(windows)]
pub(super) use bus::Device;
#[cfg(windows)]
pub use bus::{Bus, NoBus};
#[cfg(windows)]
pub use find::{Shape, find};

use super::REPORT_LEN;
use super::error::UsbError;
use super::line::{Ended, Line, Outcome};

/// Bytes of a report as the driver moves it: in front stands the report's number, 0 where a device has only one each way.
const NUMBERED_LEN: usize = REPORT_LEN + 1;
