//! The file of a recording, or a pipe to a program that shows it live.
//!
//! A program has to open its board again after SW_RESET or when a cable was pulled. So the first recording of a process
//! creates the file. Later recordings of the same process to that file append a section, which pcapng allows, and their
//! times continue those of the section before. \[OURS]
//!
//! If the file is a recording of an earlier process, it is renamed to `FILE.1` first, which replaces an older `FILE.1`.
//! \[OURS] A program that records at every start can then be started again and again, and its previous run is kept.
//!
//! Two recordings to one file at the same time are refused, and so is a file that is not a recording of ecmsk: a
//! mistyped name must not destroy a user's file. \[OURS]

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::sync::Syncing;
use crate::link::Stamp;
use crate::recording::RecordMeta;
use crate::recording::file_formats::ecmrec::header::{Header, Kind};
use crate::recording::meta::APPLICATION;

/// The state of the recordings of this process in one file.
#[derive(Clone, Debug)]
struct Progress {
    /// [`RecordMeta::base_ns`] of the latest recording: what is added to its link's times to get the times in the file.
    base_ns: u64,
    /// When the board was opened first, time in the file; `None` if that is unknown.
    opened_ns: Option<u64>,
    /// The URI of the link that is recorded.
    link: String,
    /// The time of the last frame, and the moment at which the recording ended; `None` while it is in progress.
    last: Option<(u64, Instant)>,
}

/// The files to which this process has recorded, so that its next recording to one of them is appended; `None` for a
/// file that is just being created.
static RECORDED: Mutex<BTreeMap<PathBuf, Option<Progress>>> = Mutex::new(BTreeMap::new());

fn recorded() -> MutexGuard<'static, BTreeMap<PathBuf, Option<Progress>>> {
    RECORDED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Opens the file of a recording, and locks it against other recordings. Fails if the system cannot open the file,
/// another recording is writing to it, or it is no recording of ecmsk.
pub(in crate::link) fn open(path: &Path) -> io::Result<RecordingFile> {
    let mut file = open_locked(path)?;
    // A pipe or a device has no earlier recording that could be continued or kept as `FILE.1`, and no length.
    if !file.metadata()?.is_file() {
        return Ok(RecordingFile { file, length: None, path: None, syncing: None });
    }
    let key = std::path::absolute(path)?;
    let is_first = !recorded().contains_key(&key);
    if is_first {
        // The entry marks that this process creates the file. Another thread that opens it meanwhile finds it locked.
        recorded().insert(key.clone(), None);
        match begin(path, file) {
            Ok(begun) => file = begun,
            Err(error) => {
                recorded().remove(&key);
                return Err(error);
            }
        }
    }
    let length = Some(file.seek(SeekFrom::End(0))?);
    let syncing = Syncing::begin(&file);
    Ok(RecordingFile { file, length, path: Some(key), syncing })
}

/// Opens a file for writing, and locks it against other recordings.
fn open_locked(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(false);
    #[cfg(windows)]
    {
        use std::os::windows::fs::OpenOptionsExt;
        const FILE_SHARE_READ: u32 = 1;
        options.share_mode(FILE_SHARE_READ);
    }
    let file = open_at_once(&mut options, path)?;
    // On Windows a lock would keep programs from reading the file. There the share mode keeps other writers out.
    #[cfg(not(windows))]
    if let Err(std::fs::TryLockError::WouldBlock) = file.try_lock() {
        return Err(io::Error::new(io::ErrorKind::ResourceBusy, "another recording is being written to it"));
    }
    Ok(file)
}

/// Creates the file for the first recording of this process, and renames an existing recording to `FILE.1`.
fn begin(path: &Path, file: File) -> io::Result<File> {
    if file.metadata()?.len() == 0 {
        return Ok(file);
    }
    check_replaceable(path)?;
    // If `path` is a symbolic link, its target is renamed and the link stays.
    let target = fs::canonicalize(path)?;
    let kept = kept_path(&target);
    if kept.exists() {
        check_replaceable(&kept)?;
    }
    // Windows does not rename a file that is open, so it is closed first.
    drop(file);
    fs::rename(&target, &kept)?;
    log::info!("{} was a recording already: it is {} now", target.display(), kept.display());
    open_locked(&target)
}

/// The name under which an existing recording is kept: `FILE.1`.
fn kept_path(path: &Path) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".1");
    name.into()
}

/// Makes sure that a new recording can be made at `path`: nothing must exist there, or an empty file, a pipe or a
/// device. With `overwrite` it may also be a recording, which is then removed.
///
/// The key `record=` does not need this: it keeps an existing recording as `FILE.1`.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] if there is a file that must not be removed; errors of the operating system.
pub fn make_room(path: &Path, overwrite: bool) -> io::Result<()> {
    if check_room(path, overwrite)? { fs::remove_file(fs::canonicalize(path)?) } else { Ok(()) }
}

/// Whether a recording is at `path`, which [`make_room`] would remove. Nothing is removed.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] if there is a file that [`make_room`] must not remove; errors of the operating system.
pub fn check_room(path: &Path, overwrite: bool) -> io::Result<bool> {
    match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error),
        Ok(metadata) if !metadata.is_file() || metadata.len() == 0 => return Ok(false),
        Ok(_) if !overwrite => return Err(io::Error::new(io::ErrorKind::AlreadyExists, "the file is there already")),
        Ok(_) => {}
    }
    check_replaceable(path)?;
    // Opening with the lock fails if another recording is being written to the file.
    drop(open_locked(path)?);
    Ok(true)
}

/// Opens a file without waiting; opening a pipe that nobody reads would wait for a reader.
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
    // From now on writes may wait: only the recorder's thread writes, and no thread of the program waits for it.
    fcntl_setfl(&file, fcntl_getfl(&file)? - OFlags::NONBLOCK)?;
    Ok(file)
}

#[cfg(not(unix))]
fn open_at_once(options: &mut OpenOptions, path: &Path) -> io::Result<File> {
    options.open(path)
}

/// Makes sure that the file is empty or a recording of ecmsk, whose section header names the application.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] if it is any other file; errors of the operating system.
fn check_replaceable(path: &Path) -> io::Result<()> {
    let mut start = Vec::new();
    File::open(path)?.take(SECTION_HEADER_BYTES_MAX).read_to_end(&mut start)?;
    let is_ours = match start.first_chunk::<8>() {
        Some([0x0A, 0x0D, 0x0D, 0x0A, length @ ..]) => {
            let header = &start[..start.len().min(u32::from_le_bytes(*length) as usize)];
            header.windows(APPLICATION.len()).any(|bytes| bytes == APPLICATION.as_bytes())
        }
        _ => start.is_empty() || Header::parse(&start).is_some_and(|header| header.kind == Some(Kind::Section)),
    };
    if is_ours {
        return Ok(());
    }
    let name = path.display();
    let what = format!("{name} is there and is no recording of ecmsk; it stays as it is");
    Err(io::Error::new(io::ErrorKind::AlreadyExists, what))
}

/// The longest section header of a recording of ecmsk, in bytes; it contains the URI of the link.
const SECTION_HEADER_BYTES_MAX: u64 = 1 << 20;

/// The file of a recording. A write is made completely or not at all: if the disk is full, the partial write is
/// removed.
pub(in crate::link) struct RecordingFile {
    file: File,
    /// The length after the last write that succeeded; `None` for a pipe or device, which has no length.
    length: Option<u64>,
    /// The absolute path, which is the key of the file in [`RECORDED`]; `None` for a pipe or device.
    path: Option<PathBuf>,
    /// Syncs the file to the disk; `None` for a pipe or device, and if the system provides no thread.
    syncing: Option<Syncing>,
}

impl RecordingFile {
    /// Whether the recording goes to a file on a disk, which accepts writes sooner or later, and not to a pipe, whose
    /// reader may never read.
    pub(in crate::link) const fn is_on_disk(&self) -> bool {
        self.length.is_some()
    }

    /// The metadata of a recording that begins when the link's clock shows `link_time`. Its times continue those of the
    /// previous recording in the same file. \[OURS]
    ///
    /// If the link's clock has run on since the previous recording, perhaps more slowly than real time (`rate=`,
    /// `catch_up_ms=`), the time between the two recordings is taken from this clock. If the clock has started again
    /// from its zero, it is the real time since the end of the previous recording; on a virtual clock it is 0.
    pub(in crate::link) fn continued(&self, meta: &RecordMeta, link_time: Stamp) -> RecordMeta {
        let mut meta = meta.clone();
        let Some(path) = &self.path else { return meta };
        let mut recorded = recorded();
        let progress = recorded.entry(path.clone()).or_default();
        if let Some(Progress { base_ns, link, last: Some((last_ns, ended)), .. }) = progress {
            meta.base_ns = if *link == meta.link && base_ns.saturating_add(link_time.0) >= *last_ns {
                *base_ns
            } else {
                let away = if meta.is_virtual() { 0 } else { u64::try_from(ended.elapsed().as_nanos()).unwrap_or(0) };
                last_ns.saturating_add(away).saturating_sub(link_time.0)
            };
        }
        let opened_ns = progress.as_ref().map_or_else(|| meta.opened_at_ns(), |progress| progress.opened_ns);
        *progress = Some(Progress { base_ns: meta.base_ns, opened_ns, link: meta.link.clone(), last: None });
        meta
    }

    /// The time from the first opening of the board in the file to the opening with these metadata, see
    /// [`Link::recorded_before`](crate::link::Link::recorded_before).
    pub(super) fn before(&self, meta: &RecordMeta) -> Duration {
        let first_ns = || recorded().get(self.path.as_ref()?)?.as_ref()?.opened_ns;
        let before_ns = first_ns().and_then(|first_ns| meta.opened_at_ns()?.checked_sub(first_ns));
        Duration::from_nanos(before_ns.unwrap_or(0))
    }

    /// Replaces the last `back` bytes of the file by `bytes`. If the disk is full, only bytes beyond the present end of
    /// the file fail. If the replaced bytes and the new ones are whole blocks of one length, the file then still ends
    /// with a whole block.
    fn put(&mut self, back: u64, bytes: &[u8]) -> io::Result<()> {
        let Some(length) = &mut self.length else { return self.file.write_all(bytes) };
        if let Some(syncing) = &self.syncing {
            syncing.check()?;
        }
        if back > 0 {
            self.file.seek(SeekFrom::Start(*length - back))?;
        }
        match self.file.write_all(bytes) {
            Ok(()) => {
                let is_shorter = (bytes.len() as u64) < back;
                *length = *length - back + bytes.len() as u64;
                if is_shorter {
                    self.file.set_len(*length)?;
                }
            }
            Err(error) => {
                // If this fails as well, the error of the write is the one that is reported.
                let _ = self.file.set_len(*length).and_then(|()| self.file.seek(SeekFrom::Start(*length)));
                return Err(error);
            }
        }
        if let Some(syncing) = &self.syncing {
            syncing.written();
        }
        Ok(())
    }

    /// Removes the last `bytes` bytes.
    fn truncate_by(&mut self, bytes: u64) -> io::Result<()> {
        let length = self.length.as_mut().and_then(|length| Some((length.checked_sub(bytes)?, length)));
        let Some((left, length)) = length else { return Err(io::ErrorKind::Unsupported.into()) };
        self.file.set_len(left)?;
        *length = left;
        self.file.seek(SeekFrom::Start(left)).map(drop)
    }

    /// Notes that the recording has ended; `last_ns` is the time of its last frame.
    fn ended(&self, last_ns: u64) {
        if let Some(path) = &self.path
            && let Some(Some(progress)) = recorded().get_mut(path)
        {
            // The next recording continues the times from this end. A recording without frames ends at its own
            // beginning.
            progress.last = Some((last_ns.max(progress.base_ns), Instant::now()));
        }
    }
}

impl Drop for RecordingFile {
    fn drop(&mut self) {
        // Closing the file unlocks it as well, but not while a forked process has a copy of the file descriptor.
        #[cfg(not(windows))]
        let _ = self.file.unlock();
    }
}

/// Where a recording is written to.
pub(in crate::link) enum Sink {
    /// A file, pipe or device.
    File(RecordingFile),
    /// A writer that is neither a file nor a pipe, such as a buffer in memory.
    Other(Box<dyn Write + Send>),
}

impl Sink {
    /// Whether bytes that were already written can be replaced: in a file on a disk.
    pub(super) const fn can_rewrite(&self) -> bool {
        matches!(self, Self::File(file) if file.is_on_disk())
    }

    /// Replaces the last `back` bytes by `bytes`; `back` must be 0 if written bytes cannot be replaced. Fails if the
    /// bytes cannot be written, for example on a full disk.
    pub(super) fn put(&mut self, back: u64, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::File(file) => file.put(back, bytes),
            Self::Other(sink) => sink.write_all(bytes).and_then(|()| sink.flush()),
        }
    }

    /// Removes the last `bytes` bytes.
    pub(super) fn truncate_by(&mut self, bytes: u64) -> io::Result<()> {
        match self {
            Self::File(file) => file.truncate_by(bytes),
            Self::Other(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    /// Notes that the recording has ended; `last_ns` is the time of its last frame.
    pub(super) fn ended(&self, last_ns: u64) {
        if let Self::File(file) = self {
            file.ended(last_ns);
        }
    }
}
