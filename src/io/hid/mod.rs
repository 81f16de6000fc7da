//! A HID device on USB with reports of a fixed size and one interrupt endpoint in each direction.
//!
//! [`find`] lists the devices with the board's ids and shows which of them have its report interface; [`Pipe`] sends
//! and receives reports. Transfers to the host are submitted at all times, so that no report is missed between two
//! reads. The system is accessed through a backend: libusb, or on Windows the system's own HID driver
//! (docs/decisions/windows-hid-driver.md).
//!
//! Files, in the order in which to read them:
//!
//! | file | what it holds |
//! | --- | --- |
//! | `found_device.rs` | a device on the bus, and why it may not be a board |
//! | `sysfs.rs` | Linux's information about a device: serial number, speed, processes that have it open |
//! | `pipe.rs` | an open device: `read`, `write`, `cancel`, `close` |
//! | `reports.rs` | the state behind a pipe, and its changes at the end of a transfer |
//! | `events.rs` | which thread handles the backend's events |
//! | `input_pause.rs` | reports stay in the system's queue while a program only writes |
//! | `backend.rs` | the trait through which a pipe uses the system, and `error.rs`, its errors |
//! | `libusb/` | the backend over libusb: `api` (functions), `bus` (objects), `transfer`, `backend`, `find`; in `packets` a device with packets instead of reports |
//! | `windows/` | the backend over Windows' HID driver, with the same parts |
//! | `calls.rs`, `*/fake.rs` | for tests: calls with a limit, and a simulated libusb and Windows |

mod backend;
#[cfg(test)]
mod calls;
mod error;
mod events;
mod found_device;
mod input_pause;
#[cfg(unix)]
mod libusb;
mod pipe;
mod reports;
mod sysfs;
// This module is compiled for tests on every system: Windows' functions are in a table, which the tests replace.
#[cfg(any(windows, test))]
mod windows;

pub use error::UsbError;
pub use found_device::FoundDevice;
#[cfg(unix)]
use libusb::Device;
#[cfg(unix)]
pub use libusb::{Bus, LibusbMissing, PacketDevice, PacketPlace, PacketWires, UsbBusError, UsbPacketError, find};
pub use pipe::{Pipe, PipeError, PipeOptions, PipeStats};
pub use sysfs::{DeviceHolder, DeviceWarning, Sysfs};
#[cfg(windows)]
use windows::Device;
#[cfg(windows)]
pub use windows::{Bus, ReportInterface, UsbBusError, find};

#[cfg(unix)]
pub use super::descriptors::ReportInterface;
pub use super::descriptors::{NotTheBoard, REPORT_LEN};
