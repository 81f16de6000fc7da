//! Attaches a board to this machine's own USB bus (`--attach`), through the kernel's virtual host controller (vhci_hcd)
//! and without TCP.
//!
//! Source: Documentation/ABI/testing/sysfs-platform-usbip-vudc and drivers/usb/usbip/vhci_sysfs.c of Linux.

#[cfg(target_os = "linux")]
mod linux;
#[cfg(not(target_os = "linux"))]
mod unsupported;

use std::io;
use std::path::PathBuf;

#[cfg(target_os = "linux")]
pub use linux::{Socket, attach};
#[cfg(not(target_os = "linux"))]
pub use unsupported::{Socket, attach};

/// The sysfs folder of the first virtual USB host controller of Linux (vhci_hcd).
pub const VHCI: &str = "/sys/devices/platform/vhci_hcd.0";

/// The status of a port to which nothing is attached (`VDEV_ST_NULL`).
const FREE: u32 = 4;

/// Why a board cannot be attached to this machine.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum AttachError {
    /// The kernel's virtual host controller does not exist.
    #[error(
        "this machine has no virtual USB host controller ({}): {source}; load it with `sudo modprobe vhci-hcd`",
        path.display()
    )]
    NoController {
        /// The folder of the controller that was not found.
        path: PathBuf,
        source: io::Error,
    },
    /// This operating system has no virtual host controller.
    #[error(
        "boards are attached by the kernel of Linux alone; leave out --attach, and attach them with a program of this \
         system, e.g. usbip-win2 on Windows: `usbip attach -r 127.0.0.1 -b 1-1`"
    )]
    NoKernel,
    /// The user has no right to attach devices.
    #[error("attaching a board to this machine needs root; start the same command with sudo")]
    NotAllowed,
    /// All ports of the controller are in use.
    #[error(
        "all high-speed ports of the virtual USB host controller are taken; free one with `sudo usbip detach -p N`"
    )]
    NoPort,
    /// Another client of the server has attached the board before this machine could.
    #[error("a client of the server has taken the board already; detach it there first")]
    Taken,
    /// The virtual host controller has refused the board.
    #[error("the virtual USB host controller does not take the board: {0}; `dmesg` may say more")]
    Refused(io::Error),
}

/// The free high-speed ports, from the controller's file `status`.
pub fn free_ports(status: &str) -> impl Iterator<Item = u32> + '_ {
    // The file `status` has a line of headings and a line for each port:
    //     hub port sta spd dev      sockfd local_busid
    //     hs  0000 004 000 00000000 000000 0-0
    status.lines().filter_map(|line| {
        let mut fields = line.split_whitespace();
        let (hub, port, state) = (fields.next()?, fields.next()?, fields.next()?);
        let free = hub == "hs" && state.parse() == Ok(FREE);
        free.then(|| port.parse().ok())?
    })
}
