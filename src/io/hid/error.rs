//! Why the system refuses.

/// Whose other codes are shown.
const WHOSE: &str = if cfg!(windows) { "Windows'" } else { "libusb's" };

/// Why libusb (`enum libusb_error`) or Windows refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UsbError {
    /// An error on the wire.
    #[error("input/output error")]
    Io,
    /// What was asked makes no sense, or the kernel takes no transfer of that kind.
    #[error("invalid parameter")]
    Invalid,
    /// This user may not.
    #[error("access denied")]
    Access,
    /// The device is gone.
    #[error("no such device")]
    NoDevice,
    /// It has not got what was asked for.
    #[error("not found")]
    NotFound,
    /// Another program has it.
    #[error("busy")]
    Busy,
    /// There is no memory, or the limit for transfers is reached (`usbcore.usbfs_memory_mb`).
    #[error("no memory")]
    NoMemory,
    /// This system cannot do it.
    #[error("not supported on this system")]
    NotSupported,
    /// Another one.
    #[error("{WHOSE} error {0}")]
    Other(i32),
}
