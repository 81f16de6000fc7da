//! The file of a recording.
//!
//! A program that opens its board again, as it must after SW_RESET or when a cable was pulled, does not lose what was
//! recorded before \[OURS]: the first recording of a process replaces the file, later ones to the same file append a
//! section to it, which pcapng allows. Two recordings into one file at a time are refused, and so is a file that holds
//! something else: a slip of the keyboard costs nobody a drawing or a program \[OURS].
//!
//! A pipe takes a recording too, for a program that looks at it live. Nobody waits for one that does not read.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Files that this process has recorded to.
static RECORDED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Opens the file of a recording, for this recording alone.
pub(super) fn open(path: &Path) -> io::Result<WholeWrites> {
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(false);
    #[cfg(windows)]
    {
        use std::os::windows::fs::OpenOptionsExt;
        const FILE_SHARE_READ: u32 = 1;
        options.share_mode(FILE_SHARE_READ);
    }
    let mut file = open_at_once(&mut options, path)?;
    // Windows' locks would keep readers out too; there the share mode keeps other writers out.
    #[cfg(not(windows))]
    if let Err(std::fs::TryLockError::WouldBlock) = file.try_lock() {
        return Err(io::Error::new(io::ErrorKind::ResourceBusy, "another recording is being written to it"));
    }
    let mut good = None;
    // A pipe or a device has no length.
    if file.metadata()?.is_file() {
        let first = RECORDED.lock().unwrap_or_else(PoisonError::into_inner).insert(std::path::absolute(path)?);
        if first {
            if !may_be_replaced(path)? {
                RECORDED.lock().unwrap_or_else(PoisonError::into_inner).remove(&std::path::absolute(path)?);
                return Err(io::Error::new(
                    io::ErrorKind::AlreadyExists,
                    "the file is there and is no recording of ecmsk; it stays as it is",
                ));
            }
            file.set_len(0)?;
        }
        good = Some(file.seek(SeekFrom::End(0))?);
    }
    Ok(WholeWrites { file, good })
}

/// Opening a pipe that nobody reads would wait for somebody who does.
#[cfg(unix)]
fn open_at_once(options: &mut OpenOptions, path: &Path) -> io::Result<File> {
    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
    use std::os::unix::fs::OpenOptionsExt;

    options.custom_flags(OFlags::NONBLOCK.bits() as i32);
    let file = options.open(path).map_err(|error| match error.raw_os_error() {
        Some(code) if code == libc::ENXIO => {
            io::Error::new(io::ErrorKind::NotConnected, "nobody reads the pipe; start its reader first")
        }
        _ => error,
    })?;
    // A write waits again: it is a thread of its own that writes.
    fcntl_setfl(&file, fcntl_getfl(&file)? - OFlags::NONBLOCK)?;
    Ok(file)
}

#[cfg(not(unix))]
fn open_at_once(options: &mut OpenOptions, path: &Path) -> io::Result<File> {
    options.open(path)
}

/// Whether a file is empty or a recording of ours: its section header names the application.
fn may_be_replaced(path: &Path) -> io::Result<bool> {
    let mut start = Vec::new();
    File::open(path)?.take(LONGEST_SECTION_HEADER).read_to_end(&mut start)?;
    let header = match start.first_chunk::<8>() {
        Some([0x0A, 0x0D, 0x0D, 0x0A, length @ ..]) => &start[..start.len().min(u32::from_le_bytes(*length) as usize)],
        _ => return Ok(start.is_empty()),
    };
    Ok(header.windows(APPLICATION.len()).any(|bytes| bytes == APPLICATION.as_bytes()))
}

/// How the application's name begins in a recording's section header.
const APPLICATION: &str = "ecmsk ";
/// No section header of ours is longer, whatever its link.
const LONGEST_SECTION_HEADER: u64 = 1 << 20;

/// A file that holds every write whole or not at all: what a full disk has cut is taken back.
pub(super) struct WholeWrites {
    file: File,
    /// Length after the last write that went well; `None` for what has no length.
    good: Option<u64>,
}

impl WholeWrites {
    /// Whether it is a file on a disk, which takes what it is given sooner or later. A pipe need not.
    pub(super) const fn is_on_disk(&self) -> bool {
        self.good.is_some()
    }
}

impl Drop for WholeWrites {
    fn drop(&mut self) {
        // Closing does it too, but not while a process that was just forked has a copy of the file.
        #[cfg(not(windows))]
        let _ = self.file.unlock();
    }
}

impl Write for WholeWrites {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write_all(bytes);
        if let Some(good) = &mut self.good {
            match written {
                Ok(()) => *good += bytes.len() as u64,
                Err(_) => {
                    // If this fails too, the error of the write is the one to tell.
                    let _ = self.file.set_len(*good).and_then(|()| self.file.seek(SeekFrom::Start(*good)));
                }
            }
        }
        written.map(|()| bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
