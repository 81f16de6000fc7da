//! The backend over Windows' own HID driver, which needs no installation (docs/decisions/windows-hid-driver.md).
//!
//! `api.rs` has the functions of Windows, `codes.rs` the meaning of their error codes, `names.rs` the meaning of device
//! names, `handle.rs` a handle that is closed once, `find.rs` the search for boards, `backend.rs` the transfers.
//! `fake.rs` is a simulated Windows, with which these files are tested on every system.

mod api;
mod backend;
mod bus;
mod codes;
#[cfg(test)]
mod fake;
mod find;
mod handle;
mod names;
#[cfg(test)]
mod tests;

#[cfg(windows)]
pub(super) use bus::Device;
#[cfg(windows)]
pub use bus::{Bus, UsbBusError};
#[cfg(windows)]
pub use find::{ReportInterface, find};

use super::REPORT_LEN;
use super::backend::{Backend, Outcome, TransferListener};
use super::error::UsbError;

/// Size of a report with its report id in bytes, as the driver passes it. The first byte is the id, which is 0 for a
/// device without report ids.
const NUMBERED_LEN: usize = REPORT_LEN + 1;
