//! A device on the bus with the wanted vendor and product id.

use super::{Device, NotTheBoard, ReportInterface};

/// A device on the bus with the wanted vendor and product id.
pub struct FoundDevice {
    pub(super) device: Device,
    /// Where it is plugged in: bus and ports as Linux names them (`1-2.3`), or the name of its instance in Windows with `-`
    /// for each `&` (`7-1a2b3c4d-0-0000`). \[OURS]
    pub path: String,
    /// Bus number and device address, which name its node below `/dev/bus/usb`; zeros on Windows.
    pub node: (u8, u8),
    /// Whether it runs at high speed, 480 Mbit/s; always `true` on Windows, which does not tell.
    pub high_speed: bool,
    /// The interface of its reports, or why it cannot be a board.
    pub interface: Result<ReportInterface, NotTheBoard>,
}
