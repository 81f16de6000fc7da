//! Reads small files that a user names: configuration, scripts, secrets. Anything else than a regular file is refused
//! without opening it, since opening a FIFO waits for its writer, and opening a device may have an effect on it. Files
//! that are too long are refused as well.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, Read as _};
use std::path::Path;

/// A small file that was read: its content and its metadata.
#[derive(Debug)]
pub(crate) struct SmallFile {
    /// The bytes of the file.
    pub(crate) bytes: Vec<u8>,
    /// Owner, mode and size of the file that was read. The path may name another file by now.
    #[cfg_attr(not(unix), allow(dead_code, reason = "only used on Unix, to check owner and mode of a secret"))]
    pub(crate) metadata: Metadata,
}

/// Additional capacity of the buffer beyond the length of the file. The last read finds the end of the file and needs
/// room in the buffer, too: with this capacity the buffer does not grow for it.
const READ_MIN: usize = 64;

/// Why a small file was not read. The texts do not name the path, which the caller adds.
#[derive(Debug, thiserror::Error)]
pub(crate) enum FileError {
    /// An error of the system, such as [`io::ErrorKind::NotFound`] or a missing permission.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The path is not that of a regular file.
    #[error("it is {kind}, and only regular files are read; copy its content into one")]
    Kind {
        /// The kind of the file, with an article: `a folder`.
        kind: &'static str,
    },
    /// The file is too long.
    #[error("it has more than {size_max} bytes; is it the right file?")]
    Size {
        /// The largest allowed length, bytes.
        size_max: u64,
    },
}

/// Reads the regular file at `path`, of at most `size_max` bytes. It never waits for another program: a FIFO, a socket,
/// a device, a folder, or a link to one of them is refused.
///
/// # Errors
/// [`FileError::Io`]: the file cannot be opened or read. [`FileError::Kind`]: it is no regular file.
/// [`FileError::Size`]: it has more than `size_max` bytes.
pub(crate) fn read_small(path: &Path, size_max: u64) -> Result<SmallFile, FileError> {
    // Opening a device may rewind a tape or arm a watchdog, so the kind of the file is checked before. The check is
    // repeated after opening, since the path may name another file by then.
    check_kind(&fs::metadata(path)?)?;
    let file = open(path)?;
    let metadata = file.metadata()?;
    check_kind(&metadata)?;
    if metadata.len() > size_max {
        return Err(FileError::Size { size_max });
    }
    // The buffer must not grow: the file may be a secret, and growing would leave a copy of it in memory.
    let mut bytes = Vec::with_capacity(usize::try_from(metadata.len()).unwrap_or(0) + READ_MIN);
    // The length from the metadata is no limit: the file may grow meanwhile, and files in /proc have a length of 0.
    (&file).take(size_max.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > size_max {
        return Err(FileError::Size { size_max });
    }
    Ok(SmallFile { bytes, metadata })
}

/// Opens a file so that neither opening nor reading waits, even if it was replaced by a FIFO meanwhile.
fn open(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt as _;
        options.custom_flags(libc::O_NONBLOCK | libc::O_NOCTTY);
    }
    options.open(path)
}

fn check_kind(metadata: &Metadata) -> Result<(), FileError> {
    if metadata.is_file() {
        return Ok(());
    }
    let kind = if metadata.is_dir() { "a folder" } else { special_kind(metadata) };
    Err(FileError::Kind { kind })
}

#[cfg(unix)]
fn special_kind(metadata: &Metadata) -> &'static str {
    use std::os::unix::fs::FileTypeExt as _;
    let kind = metadata.file_type();
    if kind.is_fifo() {
        "a pipe (FIFO)"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(not(unix))]
fn special_kind(_: &Metadata) -> &'static str {
    "a pipe or a device"
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    /// TOOL-136 Pipes, sockets, devices, folders and links to them are refused without opening them, and the error
    /// names the kind. Opening a FIFO without a writer would block for ever.
    #[test]
    fn what_is_no_regular_file_is_refused_by_its_kind() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        rustix::fs::mkfifoat(rustix::fs::CWD, at("fifo"), rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        std::os::unix::fs::symlink(at("fifo"), at("link")).unwrap();
        for (path, kind) in [
            (at("fifo"), "a pipe (FIFO)"),
            (at("link"), "a pipe (FIFO)"),
            (at("socket"), "a socket"),
            ("/dev/zero".into(), "a device"),
            (folder.path().into(), "a folder"),
        ] {
            let error = read_small(&path, 100).unwrap_err();
            assert!(matches!(error, FileError::Kind { kind: found } if found == kind), "{}: {error:?}", path.display());
            assert!(error.to_string().contains(kind), "{error}");
        }
        let missing = read_small(&at("missing"), 100).unwrap_err();
        assert!(matches!(missing, FileError::Io(error) if error.kind() == io::ErrorKind::NotFound));
    }

    /// TOOL-136 A file of the maximum size is read, and a longer one is refused, also if its metadata show a length of 0.
    #[test]
    fn what_is_too_long_is_refused_by_its_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, [7; 100]).unwrap();
        let read = read_small(&path, 100).unwrap();
        assert_eq!((read.bytes, read.metadata.len()), (vec![7; 100], 100));
        let error = read_small(&path, 99).unwrap_err();
        assert!(
            matches!(error, FileError::Size { size_max: 99 }) && error.to_string().contains("99 bytes"),
            "{error:?}"
        );
        // The file is sparse and takes no disk space.
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        assert!(matches!(read_small(&path, 100), Err(FileError::Size { .. })));
        // The metadata of this file show a length of 0.
        assert!(matches!(read_small(Path::new("/proc/self/maps"), 100), Err(FileError::Size { .. })));
    }
}
