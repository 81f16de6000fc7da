//! A device of the wanted pair of ids, and why it may be another one.

use super::{Device, REPORT_LEN, Shape};

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

/// Why a device with the right ids is another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotOne {
    /// No configuration of it is chosen.
    #[error(
        "this machine has not switched it on: its port or hub gives it too little power, or it is still being looked \
         at; plug it into this machine, or into a hub with a power supply of its own"
    )]
    Unconfigured,
    /// Its descriptors cannot be read or contradict each other.
    #[error("its descriptors cannot be read")]
    Descriptors,
    /// It is no HID device.
    #[error("it has no HID interface")]
    NoHid,
    /// Its reports are other ones.
    #[error("its HID interface has no interrupt endpoints of {REPORT_LEN} bytes both ways")]
    OtherReports,
}
