//! The errors of libusb and of Windows' HID driver as one type.

/// Names the system whose error codes [`UsbError::Other`] shows.
const CODES_OF: &str = if cfg!(windows) { "Windows'" } else { "libusb's" };

/// The reason why libusb (`enum libusb_error`) or Windows refuses a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UsbError {
    /// The transfer failed on the wire.
    #[error("input/output error")]
    Io,
    /// The system refuses a call as invalid: an argument is wrong, or the kernel supports no transfer of that kind.
    #[error("invalid parameter")]
    Invalid,
    /// The user has no permission.
    #[error("access denied")]
    Access,
    /// The device was unplugged.
    #[error("no such device")]
    NoDevice,
    /// The device has no such interface, configuration or endpoint.
    #[error("not found")]
    NotFound,
    /// Another program uses the device.
    #[error("busy")]
    Busy,
    /// There is not enough memory, or the kernel's limit for USB transfers is reached (`usbcore.usbfs_memory_mb`).
    #[error("no memory")]
    NoMemory,
    /// The system does not support this kind of call.
    #[error("not supported on this system")]
    NotSupported,
    /// Any other error code of libusb or Windows.
    #[error("{CODES_OF} error {0}")]
    Other(i32),
}
