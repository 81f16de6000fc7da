//! Why a board that was found does not open, and what to do.

use crate::io::hid::{FoundDevice, Holder, PipeError, Sysfs, UsbError};
use crate::link::LinkError;

/// What to do where this user may not open it, and where the system has no memory for its transfers.
#[cfg(target_os = "linux")]
const MAY_NOT: &str = "`sudo ecmsk doctor --write-udev-rule` gives it to users, and `ecmsk doctor` says what else is in \
                       the way";
#[cfg(not(any(windows, target_os = "linux")))]
const MAY_NOT: &str = "be root";
#[cfg(not(windows))]
const MORE_MEMORY: &str = "take fewer (`transfers=`), or more for all of USB: `echo 256 | sudo tee \
                           /sys/module/usbcore/parameters/usbfs_memory_mb`";
#[cfg(not(windows))]
const ANOTHER: &str = "another program (root is shown which)";
#[cfg(windows)]
const MAY_NOT: &str = "use an account that may: Device Manager shows the board under Human Interface Devices";
#[cfg(windows)]
const MORE_MEMORY: &str = "take fewer (`transfers=`), or end other programs";
#[cfg(windows)]
const ANOTHER: &str = "another program that lets nobody else in (close programs for HID devices one by one)";

/// What the system said, in the words of a link.
pub(super) fn refused(name: &str, board: &FoundDevice, error: PipeError, system: &Sysfs) -> LinkError {
    let path = &board.path;
    let no_board = |reason: String| LinkError::NoBoard { name: name.to_owned(), reason };
    match error {
        PipeError::Usb(UsbError::Access) => {
            no_board(format!("the one at {path} may not be opened by this user; {MAY_NOT}"))
        }
        PipeError::Usb(UsbError::Busy) => LinkError::InUse {
            name: name.to_owned(),
            by: by(path, &system.holders(board.node)),
            instead: "share the board by `ecmsk serve tcp`",
        },
        PipeError::Usb(UsbError::NoMemory) => no_board(format!(
            "the one at {path} does not open: this machine gives no memory for transfers; {MORE_MEMORY}"
        )),
        PipeError::Usb(UsbError::NoDevice) | PipeError::Lost(_) => {
            no_board(format!("the one at {path} went away while it was opened; open it again"))
        }
        other => no_board(format!("the one at {path} does not open: {other}; pull it and plug it in again")),
    }
}

/// ` by press (PID 12), the board at 1-2`.
fn by(path: &str, holders: &[Holder]) -> String {
    let names: Vec<String> = holders.iter().map(Holder::to_string).collect();
    let who = if names.is_empty() { ANOTHER.to_owned() } else { names.join(" and ") };
    format!(" by {who}, the board at {path}")
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// LIB-46 Who has the board is named where the system shows it.
    #[test]
    fn whoever_has_the_board_is_named() {
        let holder = |pid, name: &str| Holder { pid, name: name.into() };
        assert_eq!(by("1-2", &[holder(12, "press")]), " by press (PID 12), the board at 1-2");
        let both = [holder(12, "press"), holder(std::process::id(), "this")];
        assert_eq!(by("1-2", &both), " by press (PID 12) and this process, the board at 1-2");
        assert_eq!(by("1-2", &[]), " by another program (root is shown which), the board at 1-2");
    }
}
