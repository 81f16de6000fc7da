//! The backend over libusb, for every system except Windows.
//!
//! From the library upwards: `api.rs` has libusb's functions, looked up by name; `bus.rs` its objects as Rust types;
//! `transfer.rs` its asynchronous transfers; `find.rs` the search for boards; `backend.rs` an open board; `packets.rs`
//! an open device other than a board. `fake.rs` replaces the library in tests.

mod api;
mod backend;
mod bus;
#[cfg(test)]
pub(super) mod fake;
mod find;
mod packets;
mod transfer;

pub use api::LibusbMissing;
#[cfg(test)]
pub(super) use api::status;
pub(super) use bus::Device;
pub use bus::{Bus, UsbBusError};
pub use find::find;
pub use packets::{PacketDevice, PacketPlace, PacketWires, UsbPacketError};

pub(super) use super::backend::{Backend, Outcome, TransferListener};
pub(super) use super::error::UsbError;
pub(super) use super::found_device::FoundDevice;
use super::{NotTheBoard, REPORT_LEN, ReportInterface, Sysfs};
