//! A device on the USB bus that has the board's vendor and product id.

use super::{Device, NotTheBoard, ReportInterface};

/// A device on the USB bus that has the vendor and product id for which [`find`](super::find) has searched.
pub struct FoundDevice {
    pub(super) device: Device,
    /// Where the device is plugged in: bus and ports as Linux names them (`1-2.3`). On Windows the device's instance
    /// name, with `-` in place of each `&` (`7-1a2b3c4d-0-0000`), because `&` has a meaning in a link URI. \[OURS]
    pub path: String,
    /// Bus number and device address, which name the device node below `/dev/bus/usb`; zeros on Windows.
    pub bus_and_address: (u8, u8),
    /// Whether the device runs at high speed, 480 Mbit/s; always `true` on Windows, which does not report it.
    pub high_speed: bool,
    /// The interface through which the device exchanges reports, or the reason why the device cannot be a board.
    pub interface: Result<ReportInterface, NotTheBoard>,
}
