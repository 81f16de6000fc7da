//! USB by libusb: every system but Windows.

mod api;
mod bus;
mod claimed;
#[cfg(test)]
pub(super) mod fake;
mod find;
mod transfer;

pub use api::NoLibrary;
#[cfg(test)]
pub(super) use api::status;
pub(super) use bus::Device;
pub use bus::{Bus, NoBus};
pub use find::find;

pub(super) use super::error::UsbError;
pub(super) use super::found::Found;
pub(super) use super::line::{Ended, Line, Outcome};
use super::{NotOne, REPORT_LEN, Shape, System};
