//! The error code that GetLastError of Windows returns after a call of the vendor's four functions. Programs read it,
//! because the vendor's library leaves there the code of the Windows function that failed.

use ecmsk::link::LinkError;

use crate::error::CallError;
use crate::module::set_last_error;

/// `ERROR_SUCCESS`: set after OpenECMUSB, even if that has failed.
const NO_ERROR: u32 = 0;
/// `ERROR_ACCESS_DENIED`: the device was unplugged, or the board was closed during the call.
const ACCESS_DENIED: u32 = 5;
/// `ERROR_INVALID_HANDLE`: no board is open.
const INVALID_HANDLE: u32 = 6;
/// `ERROR_GEN_FAILURE`: the device did not do what it was asked for.
const GEN_FAILURE: u32 = 31;
/// `ERROR_INVALID_PARAMETER`: `data` is NULL or `dwlength` is 0.
const INVALID_PARAMETER: u32 = 87;

/// Sets what GetLastError returns after OpenECMUSB: the same code whether it succeeds or fails.
pub fn after_open() {
    set_last_error(NO_ERROR);
}

/// Sets what GetLastError returns after ECMUSBWrite and ECMUSBRead, if they have failed. Success leaves the last error
/// unchanged.
pub fn after_transfer(result: &Result<(), Box<CallError>>) {
    if let Err(error) = result {
        set_last_error(code(error));
    }
}

/// The Windows error code of a failure. For a board that is not open, unplugged or closed, and for a write that timed
/// out, it is the code that the vendor's library sets. \[OURS] A length of 0 and NULL, which the vendor's library
/// accepts, are an invalid parameter. Failures that the vendor's library does not know, such as a read that timed out,
/// have the code of a write that timed out.
fn code(error: &CallError) -> u32 {
    match error {
        CallError::NotOpen | CallError::Forked => INVALID_HANDLE,
        CallError::Link(LinkError::Lost { .. } | LinkError::Unsure { .. } | LinkError::Closed) => ACCESS_DENIED,
        CallError::Null { .. } | CallError::NoBytes => INVALID_PARAMETER,
        _ => GEN_FAILURE,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecmsk::link::Dir;

    use super::*;

    /// LIB-64 The code of each failure of a read and a write.
    #[test]
    fn a_failure_has_the_vendors_code() {
        let timeout = |dir| LinkError::Timeout { dir, waited: Duration::from_secs(5), what: "nothing" };
        let lost = LinkError::Lost { name: "usb:".to_owned(), reason: "it was pulled".into() };
        let unsure = LinkError::Unsure { name: "tcp:".to_owned(), reason: "the server is gone".into() };
        for (error, expected) in [
            (CallError::NotOpen, 6),
            (CallError::Link(lost), 5),
            (CallError::Link(unsure), 5),
            (CallError::Link(LinkError::Closed), 5),
            (CallError::Link(timeout(Dir::Write)), 31),
            (CallError::Link(timeout(Dir::Read)), 31),
            (CallError::Link(LinkError::Io { what: "write".to_owned(), message: "it stalls".to_owned() }), 31),
            (CallError::NoBytes, 87),
            (CallError::Null { argument: "data", expected: "a frame" }, 87),
        ] {
            assert_eq!(code(&error), expected, "{error}");
        }
    }
}
