//! Explains why a board that was found cannot be opened, and what to do about it.

use crate::io::hid::{DeviceHolder, FoundDevice, PipeError, Sysfs, UsbError};
use crate::link::LinkError;

/// The advice if the user has no permission to open the board.
#[cfg(target_os = "linux")]
const IF_DENIED: &str = "`sudo ecmsk doctor --write-udev-rule` gives it to users, and `ecmsk doctor` says what else is in \
                       the way";
#[cfg(not(any(windows, target_os = "linux")))]
const IF_DENIED: &str = "be root";
/// The advice if the system has no memory for the USB transfers.
#[cfg(not(windows))]
const IF_OUT_OF_MEMORY: &str = "take fewer (`transfers=`), or more for all of USB: `echo 256 | sudo tee \
                           /sys/module/usbcore/parameters/usbfs_memory_mb`";
/// The text in place of a program's name, if the system does not show which program has the board open.
#[cfg(not(windows))]
const UNKNOWN_USER: &str = "another program (root is shown which)";
#[cfg(windows)]
const IF_DENIED: &str = "use an account that may: Device Manager shows the board under Human Interface Devices";
#[cfg(windows)]
const IF_OUT_OF_MEMORY: &str = "take fewer (`transfers=`), or end other programs";
#[cfg(windows)]
const UNKNOWN_USER: &str = "another program that lets nobody else in (close programs for HID devices one by one)";

/// Turns an error of the operating system at opening the board into the error of the link.
pub(super) fn open_error(name: &str, board: &FoundDevice, error: PipeError, system: &Sysfs) -> LinkError {
    let path = &board.path;
    let no_board = |reason: String| LinkError::NoBoard { name: name.to_owned(), reason };
    match error {
        PipeError::Usb(UsbError::Access) => {
            no_board(format!("the one at {path} may not be opened by this user; {IF_DENIED}"))
        }
        PipeError::Usb(UsbError::Busy) => LinkError::InUse {
            name: name.to_owned(),
            by: by(path, &system.holders(board.bus_and_address)),
            instead: "share the board by `ecmsk serve tcp`",
        },
        PipeError::Usb(UsbError::NoMemory) => no_board(format!(
            "the one at {path} does not open: this machine gives no memory for transfers; {IF_OUT_OF_MEMORY}"
        )),
        PipeError::Usb(UsbError::NoDevice) | PipeError::Lost(_) => {
            no_board(format!("the one at {path} went away while it was opened; open it again"))
        }
        other => no_board(format!("the one at {path} does not open: {other}; pull it and plug it in again")),
    }
}

/// The end of the error text of [`LinkError::InUse`], which names the programs that have the board open: ` by press
/// (PID 12), the board at 1-2`.
fn by(path: &str, holders: &[DeviceHolder]) -> String {
    let names: Vec<String> = holders.iter().map(DeviceHolder::to_string).collect();
    let who = if names.is_empty() { UNKNOWN_USER.to_owned() } else { names.join(" and ") };
    format!(" by {who}, the board at {path}")
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// LIB-46 The error names the program that has the board open, where the system shows it.
    #[test]
    fn the_error_for_a_board_in_use_names_its_users() {
        let holder = |pid, name: &str| DeviceHolder { pid, name: name.into() };
        assert_eq!(by("1-2", &[holder(12, "press")]), " by press (PID 12), the board at 1-2");
        let both = [holder(12, "press"), holder(std::process::id(), "this")];
        assert_eq!(by("1-2", &both), " by press (PID 12) and this process, the board at 1-2");
        assert_eq!(by("1-2", &[]), " by another program (root is shown which), the board at 1-2");
    }
}
