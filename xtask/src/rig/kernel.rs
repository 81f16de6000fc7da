//! Unpacks the kernel image (bzImage): QEMU boots the plain kernel faster, because it need not be decompressed in the guest.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::packages::Packages;
use crate::command;
use crate::error::Error;

const XZ_MAGIC: &[u8] = b"\xFD7zXZ\0";
const ELF_MAGIC: &[u8] = b"\x7FELF";

/// Writes the unpacked kernel as `vmlinux-RELEASE` into `folder`, if it is not there yet; returns its path.
pub fn unpack(packages: &Packages, folder: &Path) -> Result<PathBuf, Error> {
    let vmlinux = folder.join(format!("vmlinux-{}", packages.release));
    if vmlinux.is_file() {
        return Ok(vmlinux);
    }
    let image = packages.root.join(format!("boot/vmlinuz-{}", packages.release));
    let bytes = fs::read(&image).map_err(Error::file("read", &image))?;
    // The magic bytes of xz may also occur in the decompressor's code. The kernel is the stream that unpacks to an ELF file.
    let starts = bytes.windows(XZ_MAGIC.len()).enumerate().filter(|(_, window)| *window == XZ_MAGIC);
    for (at, _) in starts {
        let unpacked = unxz(&bytes[at..])?;
        if unpacked.starts_with(ELF_MAGIC) {
            let new = folder.join("vmlinux.new");
            fs::write(&new, unpacked).map_err(Error::file("write", &new))?;
            fs::rename(&new, &vmlinux).map_err(Error::file("rename", &new))?;
            return Ok(vmlinux);
        }
    }
    Err(Error::Rig("the kernel is packed otherwise than Debian 12 does it (xz); run it on Debian 12"))
}

/// Unpacks the xz stream at the beginning of `bytes`; the result is empty if there is none.
fn unxz(bytes: &[u8]) -> Result<Vec<u8>, Error> {
    let mut xz = Command::new("xz");
    xz.args(["--decompress", "--stdout", "--single-stream"]);
    xz.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let start = |source| Error::Start { command: "xz".to_owned(), source };
    let mut child = xz.spawn().map_err(start)?;
    let input = child.stdin.take();
    let output = std::thread::scope(|scope| {
        scope.spawn(move || {
            // xz stops reading at the end of the stream, so writing the bytes after it may fail.
            let _ = input.map(|mut input| input.write_all(bytes));
        });
        child.wait_with_output()
    });
    output.map(|output| output.stdout).map_err(|source| Error::Start { command: command::shown(&xz), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The output of `printf hello | xz`, as a small stream to unpack.
    const HELLO: [u8; 64] = [
        0xFD, 0x37, 0x7A, 0x58, 0x5A, 0x00, 0x00, 0x04, 0xE6, 0xD6, 0xB4, 0x46, 0x02, 0x00, 0x21, 0x01, 0x16, 0x00,
        0x00, 0x00, 0x74, 0x2F, 0xE5, 0xA3, 0x01, 0x00, 0x04, 0x68, 0x65, 0x6C, 0x6C, 0x6F, 0x00, 0x00, 0x00, 0x00,
        0xB1, 0x37, 0xB9, 0xDB, 0xE5, 0xDA, 0x1E, 0x9B, 0x00, 0x01, 0x1D, 0x05, 0xB8, 0x2D, 0x80, 0xAF, 0x1F, 0xB6,
        0xF3, 0x7D, 0x01, 0x00, 0x00, 0x00, 0x00, 0x04, 0x59, 0x5A,
    ];

    #[test]
    fn a_stream_is_unpacked_whatever_comes_after_it() {
        let bytes = [&HELLO[..], b"and more"].concat();
        assert_eq!(unxz(&bytes).unwrap(), b"hello");
        assert_eq!(unxz(b"no stream").unwrap(), b"");
    }
}
