//! The meaning of Windows' error codes (`winerror.h`) for a device.

use super::{Outcome, UsbError};

/// `ERROR_IO_PENDING`: the transfer is submitted.
pub const PENDING: u32 = 997;
/// `WAIT_TIMEOUT`: nothing happened within the limit.
pub const NOTHING_YET: u32 = 258;
/// `ERROR_OPERATION_ABORTED`: the transfer was cancelled.
const ABORTED: u32 = 995;

/// The codes that mean that the device was unplugged. The version of Windows and the moment of the call decide which
/// code a call returns: not found (2, 3), access denied (5, on an open handle whose device is being deleted), invalid
/// handle (6), no such device (55, 433), delete pending (303), not connected (1167), removed (1617).
const GONE: [u32; 9] = [2, 3, 5, 6, 55, 303, 433, 1167, 1617];

/// How a transfer has ended, by Windows' error code for it; 0 is success.
pub fn outcome(code: u32) -> Outcome {
    match code {
        0 => Outcome::Done,
        ABORTED => Outcome::Cancelled,
        code if GONE.contains(&code) => Outcome::Gone,
        _ => Outcome::Failed,
    }
}

/// The error of submitting a transfer to an open device, by Windows' error code.
pub fn submit_error(code: u32) -> UsbError {
    if GONE.contains(&code) { UsbError::NoDevice } else { open_error(code) }
}

/// The error of opening a device, by Windows' error code.
pub fn open_error(code: u32) -> UsbError {
    match code {
        // The codes in `GONE` except 5 and 6, which have another meaning when a device is opened.
        2 | 3 | 55 | 303 | 433 | 1167 | 1617 => UsbError::NoDevice,
        5 => UsbError::Access,
        // Out of memory (8, 14), of system resources (1450), or of quota (1816).
        8 | 14 | 1450 | 1816 => UsbError::NoMemory,
        // Another program has opened the device without sharing it.
        32 => UsbError::Busy,
        // General failure (31), timeout on the wire (121), I/O error (1117).
        31 | 121 | 1117 => UsbError::Io,
        1 | 50 => UsbError::NotSupported,
        // Invalid parameter (87), or invalid user buffer (1784): a report of another length.
        87 | 1784 => UsbError::Invalid,
        other => UsbError::Other(i32::try_from(other).unwrap_or(i32::MAX)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// WIN-43 Each error code is mapped to the state of the device that it means.
    #[test]
    fn a_code_says_what_has_become_of_the_device() {
        assert_eq!(outcome(0), Outcome::Done);
        assert_eq!(outcome(995), Outcome::Cancelled);
        for code in [5, 433, 1167, 1617] {
            assert_eq!((outcome(code), submit_error(code)), (Outcome::Gone, UsbError::NoDevice), "{code}");
        }
        assert_eq!((outcome(31), submit_error(31)), (Outcome::Failed, UsbError::Io), "the wire may be better soon");
        let opening = [2, 5, 32, 1450, 1784, 1234].map(open_error);
        let expected = [
            UsbError::NoDevice,
            UsbError::Access,
            UsbError::Busy,
            UsbError::NoMemory,
            UsbError::Invalid,
            UsbError::Other(1234),
        ];
        assert_eq!(opening, expected);
    }
}
