//! Systems whose kernel has no such controller.

use std::path::Path;

use super::AttachError;

/// Nobody has one.
pub type Socket = std::net::TcpStream;

/// There is nothing to hand it to.
///
/// # Errors
/// [`AttachError::NoKernel`].
pub fn attach(_vhci: &Path, _device_id: u32) -> Result<(Socket, u32), AttachError> {
    Err(AttachError::NoKernel)
}
