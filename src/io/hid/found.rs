//! A device of the wanted pair of ids.

use super::{Device, NotOne, Shape};

/// A device of the wanted pair of ids.
pub struct Found {
    pub(super) device: Device,
    /// Where it is plugged in: bus and ports as Linux names it (`1-2.3`), or Windows' name of its instance with `-` for
    /// each `&` (`7-1a2b3c4d-0-0000`). \[OURS]
    pub path: String,
    /// Number of the bus and address on it: those of its node below `/dev/bus/usb`; zeros on Windows.
    pub node: (u8, u8),
    /// Whether the bus runs at high speed; `true` on Windows, which does not say.
    pub high_speed: bool,
    /// Where its reports move, or why it is another device.
    pub shape: Result<Shape, NotOne>,
}
