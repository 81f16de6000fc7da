//! What Windows' GetLastError gives after a call of the vendor's four functions. Programs look at it: the vendor's library
//! leaves there what Windows' own functions said to it.

use ecmsk::link::LinkError;

use crate::error::CallError;
use crate::module::set_last_error;

/// OpenECMUSB that gives true leaves no error.
const NO_ERROR: u32 = 0;
/// `ERROR_ACCESS_DENIED`: what a handle says whose device is gone, or that is closed under a call.
const ACCESS_DENIED: u32 = 5;
/// `ERROR_INVALID_HANDLE`: nothing is open.
const INVALID_HANDLE: u32 = 6;
/// `ERROR_GEN_FAILURE`: the device did not do it.
const GEN_FAILURE: u32 = 31;
/// `ERROR_INVALID_PARAMETER`
const INVALID_PARAMETER: u32 = 87;

/// After OpenECMUSB.
pub fn after_open(result: &Result<(), Box<CallError>>) {
    if result.is_ok() {
        set_last_error(NO_ERROR);
    }
    // \[OURS] One that fails leaves the last error as it was: what the vendor's leaves there is not known.
}

/// After ECMUSBWrite and ECMUSBRead; their success leaves the last error as it was.
pub fn after_transfer(result: &Result<(), Box<CallError>>) {
    if let Err(error) = result {
        set_last_error(code(error));
    }
}

/// Not open, gone, closed, and a write that was given up: as the vendor's library. \[OURS] A length of 0 and NULL, which the
/// vendor's takes, are an invalid parameter; what the vendor's library has not, such as the limit of a read, is the same
/// failure as a write that was given up.
fn code(error: &CallError) -> u32 {
    match error {
        CallError::NotOpen | CallError::Forked => INVALID_HANDLE,
        CallError::Link(LinkError::Lost { .. } | LinkError::Closed) => ACCESS_DENIED,
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
        for (error, expected) in [
            (CallError::NotOpen, 6),
            (CallError::Link(lost), 5),
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
