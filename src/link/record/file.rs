//! The file of a recording.
//!
//! A program that opens its board again, as it must after SW_RESET or when a cable was pulled, does not lose what was
//! recorded before \[OURS]: the first recording of a process begins the file, later ones to the same file append a
//! section to it, which pcapng allows, and their times go on where those before have ended. A recording that was there
//! before is kept beside it as `FILE.1`, one of them \[OURS]: a program whose link records, and that is started every
//! morning, starts, and what it did yesterday is not gone. Two recordings into one file at a time are refused, and so is a
//! file that holds something else: a slip of the keyboard costs nobody a drawing or a program \[OURS].
//!
//! A pipe takes a recording too, for a program that looks at it live. Nobody waits for one that does not read.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::sync::Syncing;
use crate::link::Stamp;
use crate::recording::RecordMeta;
use crate::recording::meta::APPLICATION;

/// How far this process has come with a file.
#[derive(Clone, Debug)]
struct Progress {
    base_ns: u64,
    link: String,
    /// Time of the last frame in the file, and when that recording ended; `None`: it has not.
    last: Option<(u64, Instant)>,
}

/// Files that this process has recorded to; `None`: one that is just being begun.
static RECORDED: Mutex<BTreeMap<PathBuf, Option<Progress>>> = Mutex::new(BTreeMap::new());

fn recorded() -> MutexGuard<'static, BTreeMap<PathBuf, Option<Progress>>> {
    RECORDED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Opens the file of a recording, for this recording alone.
pub(super) fn open(path: &Path) -> io::Result<WholeWrites> {
    let mut file = open_alone(path)?;
    // A pipe or a device has no length.
    if !file.metadata()?.is_file() {
        return Ok(WholeWrites { file, good: None, path: None, syncing: None });
    }
    let key = std::path::absolute(path)?;
    let is_first = !recorded().contains_key(&key);
    if is_first {
        // Another thread that comes to it meanwhile finds it locked.
        recorded().insert(key.clone(), None);
        match begin(path, file) {
            Ok(begun) => file = begun,
            Err(error) => {
                recorded().remove(&key);
                return Err(error);
            }
        }
    }
    let good = Some(file.seek(SeekFrom::End(0))?);
    let syncing = Syncing::begin(&file);
    Ok(WholeWrites { file, good, path: Some(key), syncing })
}

fn open_alone(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(false);
    #[cfg(windows)]
    {
        use std::os::windows::fs::OpenOptionsExt;
        const FILE_SHARE_READ: u32 = 1;
        options.share_mode(FILE_SHARE_READ);
    }
    let file = open_at_once(&mut options, path)?;
    // Windows' locks would keep readers out too; there the share mode keeps other writers out.
    #[cfg(not(windows))]
    if let Err(std::fs::TryLockError::WouldBlock) = file.try_lock() {
        return Err(io::Error::new(io::ErrorKind::ResourceBusy, "another recording is being written to it"));
    }
    Ok(file)
}

/// The process's first recording to a file: one that is there goes out of its way.
fn begin(path: &Path, file: File) -> io::Result<File> {
    if file.metadata()?.len() == 0 {
        return Ok(file);
    }
    may_go(path)?;
    // What a link of the file system points to is the recording.
    let there = fs::canonicalize(path)?;
    let kept = before(&there);
    if kept.exists() {
        may_go(&kept)?;
    }
    // Windows moves no file that is open.
    drop(file);
    fs::rename(&there, &kept)?;
    log::info!("{} was a recording already: it is {} now", there.display(), kept.display());
    open_alone(&there)
}

/// Where a recording is kept that was in the place of a new one.
fn before(path: &Path) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".1");
    name.into()
}

/// Makes sure that a recording may begin at `path`: that nothing is there, or nothing but an empty file, or a place without
/// a length, as a pipe. With `overwrite` a recording may be there; it is removed.
///
/// A link's own `record=` asks for less: it keeps what is there beside the new one.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] if a file is there that stays; else the system's.
pub fn make_room(path: &Path, overwrite: bool) -> io::Result<()> {
    match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error),
        Ok(there) if !there.is_file() || there.len() == 0 => return Ok(()),
        Ok(_) if !overwrite => return Err(io::Error::new(io::ErrorKind::AlreadyExists, "the file is there already")),
        Ok(_) => {}
    }
    may_go(path)?;
    // Whoever records to it has it.
    drop(open_alone(path)?);
    fs::remove_file(fs::canonicalize(path)?)
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

/// # Errors
/// [`io::ErrorKind::AlreadyExists`] if a file is neither empty nor a recording of ours: then its section header names the
/// application.
fn may_go(path: &Path) -> io::Result<()> {
    let mut start = Vec::new();
    File::open(path)?.take(LONGEST_SECTION_HEADER).read_to_end(&mut start)?;
    let is_ours = match start.first_chunk::<8>() {
        Some([0x0A, 0x0D, 0x0D, 0x0A, length @ ..]) => {
            let header = &start[..start.len().min(u32::from_le_bytes(*length) as usize)];
            header.windows(APPLICATION.len()).any(|bytes| bytes == APPLICATION.as_bytes())
        }
        _ => start.is_empty(),
    };
    if is_ours {
        return Ok(());
    }
    let name = path.display();
    let what = format!("{name} is there and is no recording of ecmsk; it stays as it is");
    Err(io::Error::new(io::ErrorKind::AlreadyExists, what))
}

/// No section header of ours is longer, whatever its link.
const LONGEST_SECTION_HEADER: u64 = 1 << 20;

/// A file that holds every write whole or not at all: what a full disk has cut is taken back.
pub(super) struct WholeWrites {
    file: File,
    /// Length after the last write that went well; `None` for what has no length.
    good: Option<u64>,
    /// Of a file on a disk.
    path: Option<PathBuf>,
    /// Asks the system to bring it to the disk.
    syncing: Option<Syncing>,
}

impl WholeWrites {
    /// Whether it is a file on a disk, which takes what it is given sooner or later. A pipe need not.
    pub(super) const fn is_on_disk(&self) -> bool {
        self.good.is_some()
    }

    /// `meta` of a recording that begins when the link's clock shows `link_time`: its times go on where those of the
    /// recording before in the same file have ended. \[OURS]
    ///
    /// The board's clock may have gone on meanwhile, slower than that of the wall (`rate=`, `catch_up_ms=`): then it says
    /// how much time has passed. Where it began anew, time has passed as on the wall.
    pub(super) fn continued(&self, meta: &RecordMeta, link_time: Stamp) -> RecordMeta {
        let mut meta = meta.clone();
        let Some(path) = &self.path else { return meta };
        let mut recorded = recorded();
        let progress = recorded.entry(path.clone()).or_default();
        if let Some(Progress { base_ns, link, last: Some((last_ns, ended)) }) = progress {
            meta.base_ns = if *link == meta.link && base_ns.saturating_add(link_time.0) >= *last_ns {
                *base_ns
            } else {
                let away = if meta.is_virtual() { 0 } else { u64::try_from(ended.elapsed().as_nanos()).unwrap_or(0) };
                last_ns.saturating_add(away).saturating_sub(link_time.0)
            };
        }
        *progress = Some(Progress { base_ns: meta.base_ns, link: meta.link.clone(), last: None });
        meta
    }

    /// Writes bytes in the place of the last `back` ones. Those were frames, and these begin with frames: what a full disk
    /// does not take is lost at the end.
    fn put(&mut self, back: u64, bytes: &[u8]) -> io::Result<()> {
        let Some(good) = &mut self.good else { return self.file.write_all(bytes) };
        if let Some(syncing) = &self.syncing {
            syncing.check()?;
        }
        if back > 0 {
            self.file.seek(SeekFrom::Start(*good - back))?;
        }
        match self.file.write_all(bytes) {
            Ok(()) => *good = *good - back + bytes.len() as u64,
            Err(error) => {
                // If this fails too, the error of the write is the one to tell.
                let _ = self.file.set_len(*good).and_then(|()| self.file.seek(SeekFrom::Start(*good)));
                return Err(error);
            }
        }
        if let Some(syncing) = &self.syncing {
            syncing.written();
        }
        Ok(())
    }

    fn take_back(&mut self, bytes: u64) -> io::Result<()> {
        let good = self.good.as_mut().and_then(|good| Some((good.checked_sub(bytes)?, good)));
        let Some((left, good)) = good else { return Err(io::ErrorKind::Unsupported.into()) };
        self.file.set_len(left)?;
        *good = left;
        self.file.seek(SeekFrom::Start(left)).map(drop)
    }

    fn ended(&self, last_ns: u64) {
        if let Some(path) = &self.path
            && let Some(Some(progress)) = recorded().get_mut(path)
        {
            // Nothing was recorded: the recording ends where it would have begun.
            progress.last = Some((last_ns.max(progress.base_ns), Instant::now()));
        }
    }
}

impl Drop for WholeWrites {
    fn drop(&mut self) {
        // Closing does it too, but not while a process that was just forked has a copy of the file.
        #[cfg(not(windows))]
        let _ = self.file.unlock();
    }
}

/// Where a recording goes.
pub(super) enum Sink {
    /// A file, or a pipe.
    File(WholeWrites),
    /// Anything that takes bytes.
    Other(Box<dyn Write + Send>),
}

impl Sink {
    /// Whether what was written can be written anew.
    pub(super) const fn can_go_back(&self) -> bool {
        matches!(self, Self::File(file) if file.is_on_disk())
    }

    /// Writes bytes in the place of the last `back` ones, 0 where it cannot go back.
    pub(super) fn put(&mut self, back: u64, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::File(file) => file.put(back, bytes),
            Self::Other(sink) => sink.write_all(bytes).and_then(|()| sink.flush()),
        }
    }

    /// Takes the last bytes away.
    pub(super) fn take_back(&mut self, bytes: u64) -> io::Result<()> {
        match self {
            Self::File(file) => file.take_back(bytes),
            Self::Other(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    /// The recording ends, its last frame having passed then.
    pub(super) fn ended(&self, last_ns: u64) {
        if let Self::File(file) = self {
            file.ended(last_ns);
        }
    }
}
