//! Stands for `linux.rs` on operating systems without a virtual host controller.

use std::path::Path;

use super::AttachError;

/// A placeholder: no value of this type is ever made.
pub type Socket = std::net::TcpStream;

/// Always fails.
///
/// # Errors
/// [`AttachError::NoKernel`].
pub fn attach(_vhci: &Path, _device_id: u32) -> Result<(Socket, u32), AttachError> {
    Err(AttachError::NoKernel)
}
