//! Replaces `linux.rs` on operating systems without a virtual host controller.

use std::path::Path;

use super::AttachError;

/// The type of a connection to the kernel, to which other files refer. On these systems no value of it exists.
pub type Socket = std::net::TcpStream;

/// Always fails.
///
/// # Errors
/// [`AttachError::NoKernel`]: only Linux has a virtual host controller.
pub fn attach(_vhci: &Path, _device_id: u32) -> Result<(Socket, u32), AttachError> {
    Err(AttachError::NoKernel)
}
