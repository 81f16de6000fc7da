//! `--attach`: the boards at this machine's own USB bus, by the kernel's virtual host controller (vhci_hcd), without TCP.
//!
//! Source: Documentation/ABI/testing/sysfs-platform-usbip-vudc and drivers/usb/usbip/vhci_sysfs.c of Linux.

use std::fs;
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

use super::wire::HIGH_SPEED;

/// Where the kernel shows the controller.
pub const VHCI: &str = "/sys/devices/platform/vhci_hcd.0";

/// A port's status when nothing is attached (`VDEV_ST_NULL`).
const FREE: u32 = 4;

/// Why a board cannot be attached to this machine.
#[derive(Debug, thiserror::Error)]
pub enum AttachError {
    /// The kernel's controller is not there.
    #[error(
        "this machine has no virtual USB host controller ({}): {source}; load it with `sudo modprobe vhci-hcd`",
        path.display()
    )]
    NoController {
        /// Where it should be.
        path: PathBuf,
        /// The system's words.
        source: io::Error,
    },
    /// The user may not.
    #[error("attaching a board to this machine needs root; start the same command with sudo")]
    NotAllowed,
    /// All ports are taken.
    #[error(
        "all high-speed ports of the virtual USB host controller are taken; free one with `sudo usbip detach -p N`"
    )]
    NoPort,
    /// A client was faster.
    #[error("a client of the server has taken the board already; detach it there first")]
    Taken,
    /// The kernel did not take it.
    #[error("the virtual USB host controller does not take the board: {0}; `dmesg` may say more")]
    Refused(io::Error),
}

/// The free high-speed ports of a controller's `status`.
pub fn free_ports(status: &str) -> impl Iterator<Item = u32> + '_ {
    // hub port sta spd dev      sockfd local_busid
    // hs  0000 004 000 00000000 000000 0-0
    status.lines().filter_map(|line| {
        let mut fields = line.split_whitespace();
        let (hub, port, state) = (fields.next()?, fields.next()?, fields.next()?);
        let free = hub == "hs" && state.parse() == Ok(FREE);
        free.then(|| port.parse().ok())?
    })
}

/// Hands a device to the controller in the folder `vhci`; gives our end of the connection and the port.
///
/// # Errors
/// [`AttachError`].
pub fn attach(vhci: &Path, device_id: u32) -> Result<(UnixStream, u32), AttachError> {
    let status = vhci.join("status");
    let status =
        fs::read_to_string(&status).map_err(|source| AttachError::NoController { path: status.clone(), source })?;
    let (ours, theirs) = UnixStream::pair().map_err(AttachError::Refused)?;
    for port in free_ports(&status) {
        let order = format!("{port} {} {device_id} {HIGH_SPEED}", theirs.as_raw_fd());
        match fs::write(vhci.join("attach"), order) {
            Ok(()) => return Ok((ours, port)),
            // Somebody was faster.
            Err(error) if error.kind() == io::ErrorKind::ResourceBusy => {}
            Err(error) if error.kind() == io::ErrorKind::PermissionDenied => return Err(AttachError::NotAllowed),
            Err(error) => return Err(AttachError::Refused(error)),
        }
    }
    Err(AttachError::NoPort)
}
