//! Attaches a device to the virtual host controller of Linux.

use std::fs;
use std::io;
use std::os::fd::AsRawFd;
use std::path::Path;

use super::{AttachError, free_ports};
use crate::port::usbip::wire::HIGH_SPEED;

/// The type of the server's end of the connection to the kernel.
pub type Socket = std::os::unix::net::UnixStream;

/// Attaches a device to the controller in the folder `vhci`. Returns the server's end of the connection and the number
/// of the port.
///
/// # Errors
/// [`AttachError`]: there is no virtual host controller, no port of it is free, the user has no right, or the kernel
/// refuses the device.
pub fn attach(vhci: &Path, device_id: u32) -> Result<(Socket, u32), AttachError> {
    let status = vhci.join("status");
    let status =
        fs::read_to_string(&status).map_err(|source| AttachError::NoController { path: status.clone(), source })?;
    let (ours, theirs) = Socket::pair().map_err(AttachError::Refused)?;
    for port in free_ports(&status) {
        let order = format!("{port} {} {device_id} {HIGH_SPEED}", theirs.as_raw_fd());
        match fs::write(vhci.join("attach"), order) {
            Ok(()) => return Ok((ours, port)),
            // Another program has attached a device to this port meanwhile: the next free port is tried.
            Err(error) if error.kind() == io::ErrorKind::ResourceBusy => {}
            Err(error) if error.kind() == io::ErrorKind::PermissionDenied => return Err(AttachError::NotAllowed),
            Err(error) => return Err(AttachError::Refused(error)),
        }
    }
    Err(AttachError::NoPort)
}
