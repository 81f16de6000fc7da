//! The link key `flight=`: a flight recorder. It keeps the frames of the last hours in a folder, up to a bound in
//! bytes. It keeps the frames around an event for longer, up to a second bound.
//!
//! The frames are in files of up to 30 s, the segments of a ring. When the bound is reached, the oldest segment is
//! deleted. An event, such as an alarm, makes a moment: the frames from 30 s before it to 10 s after it are copied to a
//! recording of their own. Segments and moments are ordinary recordings (`.ecmrec`), with numbers in their names, so
//! that setting the clock of the machine does not change their order.
//!
//! The recorder's thread and a second thread do all the work. They get the frames through the same queue as `record=`,
//! so that on the real clock no call of the program waits for the disk.
//!
//! The file of a segment only grows, and once a second it is synced to the disk. So a power cut loses at most the
//! frames of the last second (docs/decisions/a-flight-recorder-writes-frames-twice.md). Files:
//!
//! - `mod.rs`: the options, the length of moments, and the lock on the folder
//! - `writer.rs`: writes the frames of the queue to segments; `ring.rs`: the numbers and lengths of the segments
//! - `keeper.rs`: syncing, compressed segments, moments and marks; `helper.rs`: the thread that does it
//! - `moment.rs`: the text beside the recording of a moment; `state.rs`: the file `writer.txt`
//! - `folder.rs`: the folder on the disk
//! - `contents.rs`: what is in a folder; marks

mod contents;
mod folder;
mod helper;
mod keeper;
mod moment;
mod ring;
mod state;
#[cfg(test)]
mod tests;
mod writer;

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

pub use contents::{FlightContents, FlightSegment, KeptMoment, lacks, mark, prepare};
pub use moment::{Kind, MARK_MAX, Moment, Reason};

use self::folder::Disk;
use self::writer::{Bounds, FlightWriter, Help};
use super::loss::Loss;
use crate::link::Dir;
use crate::recording::{Clock, RecordMeta};
use crate::sk::Frame;

/// How long before an event its moment begins. \[OURS]
pub const BEFORE: Duration = Duration::from_secs(30);
/// How long after an event its moment ends. \[OURS]
pub const AFTER: Duration = Duration::from_secs(10);
/// The longest moment: events that come while it lasts make it longer, up to this. \[OURS]
pub const MOMENT_MAX: Duration = Duration::from_secs(600);
/// The longest duration of a segment. \[OURS]
const SEGMENT: Duration = Duration::from_secs(30);
/// A segment ends when its file reaches the bound of the ring divided by this number, so that the ring always has
/// several segments. \[OURS]
const SEGMENTS_MIN: u64 = 16;
/// How often the lock is tried again if another process has it, and the pause between two attempts: `ecmsk flight` has
/// the lock for a moment. \[OURS]
const LOOKS: u32 = 5;
const LOOK_INTERVAL: Duration = Duration::from_millis(20);
/// The file that is locked while a process records to the folder.
const LOCK: &str = "lock";

/// The options of a flight recorder, from the keys of a link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlightOptions {
    /// The folder (`flight=`).
    pub folder: PathBuf,
    /// The most bytes of the ring (`flight_bytes=`).
    pub bytes: u64,
    /// The most bytes of kept moments (`flight_kept_bytes=`).
    pub kept_bytes: u64,
    /// The following error beyond which a moment is kept (`flight_following_error=`), counts; `None`: no limit.
    pub following_error: Option<u32>,
}

/// Finds in frames the events for which moments are kept. It runs on the recorder's thread.
pub trait FlightWatch: Send + 'static {
    /// Looks at the next frame. `at_ns`: its time in the recording, nanoseconds. Calls `found` for each event that
    /// begins with this frame, with a text of one line.
    fn frame(&mut self, dir: Dir, at_ns: u64, frame: &Frame, found: &mut dyn FnMut(Kind, String));

    /// Notes that frames before the next one are missing, since the disk was slow.
    fn missed(&mut self);
}

/// Whether a process is recording to a folder.
fn is_recorded(path: &Path) -> bool {
    let Ok(file) = File::open(path.join(LOCK)) else { return false };
    match file.try_lock_shared() {
        Ok(()) => {
            let _ = file.unlock();
            false
        }
        Err(error) => matches!(error, TryLockError::WouldBlock),
    }
}

/// The lock on a folder, for as long as this value lives. The system releases the lock of a process that has ended, in
/// whatever way.
struct FolderLock(File);

impl FolderLock {
    /// # Errors
    /// [`io::ErrorKind::ResourceBusy`] with the process that has the lock.
    fn take(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().write(true).create(true).truncate(false).open(path.join(LOCK))?;
        let mut locked = file.try_lock();
        for _ in 0..LOOKS {
            if !matches!(locked, Err(TryLockError::WouldBlock)) {
                break;
            }
            std::thread::sleep(LOOK_INTERVAL);
            locked = file.try_lock();
        }
        match locked {
            Ok(()) => Ok(Self(file)),
            Err(TryLockError::Error(error)) => Err(error),
            Err(TryLockError::WouldBlock) => {
                let own = std::process::id();
                let who = match contents::writer(path) {
                    Some(pid) if pid == own => "this process is recording to it already".to_owned(),
                    Some(pid) => format!("process {pid} is recording to it"),
                    None => "another process is recording to it".to_owned(),
                };
                Err(io::Error::new(io::ErrorKind::ResourceBusy, who))
            }
        }
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // Closing the file unlocks it as well, but not while a forked process has a copy of the file descriptor.
        let _ = self.0.unlock();
    }
}

/// The writer of a flight recorder, with the lock on its folder.
pub(super) struct Flight {
    writer: FlightWriter,
    _lock: FolderLock,
}

impl Flight {
    /// Creates the folder if necessary, and locks it. `dropped` counts the frames that are missing.
    pub fn begin(
        options: &FlightOptions,
        meta: &RecordMeta,
        watch: Box<dyn FlightWatch>,
        dropped: Arc<AtomicU64>,
    ) -> io::Result<Self> {
        let name = options.folder.display().to_string();
        let disk = Disk::make(&options.folder)?;
        let lock = FolderLock::take(&options.folder)?;
        let loss = Loss::new(name.clone(), dropped);
        let bounds = Bounds { ring: options.bytes, kept: options.kept_bytes };
        let help = if meta.clock == Clock::Virtual { Help::Here } else { Help::Thread };
        let writer = FlightWriter::begin(loss, &name, Arc::new(disk), meta, bounds, watch, help)?;
        Ok(Self { writer, _lock: lock })
    }
}

impl super::writer::Writer<super::writer::FrameEntry> for Flight {
    fn push(&mut self, entry: super::writer::FrameEntry) {
        self.writer.push(entry);
    }

    fn flush(&mut self) {
        self.writer.flush();
    }

    fn end(&mut self) {
        self.writer.end();
    }

    fn loss(&mut self) -> &mut Loss {
        self.writer.loss()
    }
}
