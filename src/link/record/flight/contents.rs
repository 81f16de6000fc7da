//! Reads the folder of a flight recorder from another process, and sets marks in it.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use super::folder::{self, Disk, Folder};
use super::keeper::MARK;
use super::moment::{self, MARK_MAX, Moment, one_line};
use super::state::{self, State};
use super::{FolderLock, LOCK, is_recorded};
use crate::recording::{Clock, Outline, Recording};

/// What is in the folder of a flight recorder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlightContents {
    /// The segments of the ring, oldest first.
    pub segments: Vec<FlightSegment>,
    /// The kept moments, oldest first.
    pub moments: Vec<KeptMoment>,
    /// The process that is recording to the folder; `None` if none is, or if the system does not say.
    pub writer: Option<u32>,
}

/// A segment of the ring: an ordinary recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlightSegment {
    /// The number in the name of the file, by which segments are ordered.
    pub number: u64,
    /// The path of the segment's file.
    pub file: PathBuf,
    /// The length of the file, bytes.
    pub bytes: u64,
    /// The times of its first and its last frame, ns; `None` without frames.
    pub times_ns: Option<(u64, u64)>,
    /// Whether `times_ns` are times of a virtual clock. If not, they count from 1970-01-01, UTC.
    pub is_virtual: bool,
}

/// A kept moment: the frames around an event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeptMoment {
    /// The beginning and the end of the moment, and why it is kept.
    pub moment: Moment,
    /// The path of its recording; `None` until the recording is complete.
    pub file: Option<PathBuf>,
    /// The length of the recording, bytes.
    pub bytes: u64,
}

impl FlightContents {
    /// Reads what is in a folder, also while it is being recorded to. Files that are deleted meanwhile are left out.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotFound`] if it is not the folder of a flight recorder; errors of the operating system.
    pub fn of(path: &Path) -> io::Result<Self> {
        let disk = opened(path)?;
        let (mut segments, mut moments) = (Vec::new(), Vec::new());
        let files = disk.list()?;
        for (name, bytes) in &files {
            let file = path.join(name);
            if let Some(number) = folder::number(name, folder::segment)
                && let Ok(Some(outline)) = Outline::of(&file)
            {
                let is_virtual = is_virtual(&file);
                segments.push(FlightSegment { number, file, bytes: *bytes, times_ns: outline.times_ns, is_virtual });
            } else if let Some(number) = folder::number(name, folder::note)
                && let Ok(text) = folder::text(&disk, name, moment::TEXT_MAX)
                && let Some(moment) = Moment::parse(&text)
            {
                let name = folder::moment(number);
                let there = files.iter().find(|(file, _)| *file == name);
                let file = there.map(|_| path.join(&name));
                moments.push(KeptMoment { moment, file, bytes: there.map_or(0, |(_, bytes)| *bytes) });
            }
        }
        segments.sort_by_key(|segment| segment.number);
        moments.sort_by_key(|kept| kept.moment.number);
        let writer = if is_recorded(path) { writer(path) } else { None };
        Ok(Self { segments, moments, writer })
    }
}

fn is_virtual(file: &Path) -> bool {
    let recording = Recording::open(file).ok();
    recording.and_then(|recording| Some(recording.meta()?.clock == Clock::Virtual)).unwrap_or_default()
}

/// Opens a folder; fails if it is not the folder of a flight recorder.
fn opened(path: &Path) -> io::Result<Disk> {
    if !path.join(LOCK).is_file() {
        return Err(io::Error::new(io::ErrorKind::NotFound, "it is not the folder of a flight recorder"));
    }
    Ok(Disk::at(path))
}

/// The process that `writer.txt` names.
pub(super) fn writer(path: &Path) -> Option<u32> {
    State::read(&Disk::at(path)).map(|state| state.pid)
}

/// Marks the present moment, so that it is kept, with `text` as the reason. The process that records to the folder
/// finds the mark within a second, at its next frame, and deletes the file of the mark. Returns the path of this file.
///
/// # Errors
/// [`io::ErrorKind::NotFound`] if it is not the folder of a flight recorder, [`io::ErrorKind::NotConnected`] if no
/// process is recording to it; errors of the operating system.
pub fn mark(path: &Path, text: &str) -> io::Result<PathBuf> {
    let disk = opened(path)?;
    if !is_recorded(path) {
        return Err(io::Error::new(io::ErrorKind::NotConnected, "nothing is being recorded to it"));
    }
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
    let name = format!("{now}-{}{MARK}", std::process::id());
    let text = one_line(text);
    folder::put_text(&disk, &name, &text[..text.floor_char_boundary(MARK_MAX)])?;
    Ok(path.join(name))
}

/// What the last recording to a folder lacks, as text for messages that name the folder themselves. `None` if the
/// recording is complete or still in progress, or if there is none.
pub fn lacks(path: &Path) -> Option<String> {
    let disk = opened(path).ok()?;
    let state = State::read(&disk)?;
    if is_recorded(path) { None } else { state.lacks() }
}

/// Makes sure that a process can record to the folder: creates it, and removes the note how an earlier recording has
/// ended, so that [`lacks`] describes only the next one.
///
/// # Errors
/// [`io::ErrorKind::ResourceBusy`] with the process that is recording to it; errors of the operating system.
pub fn prepare(path: &Path) -> io::Result<()> {
    let disk = Disk::make(path)?;
    let _lock = FolderLock::take(path)?;
    match disk.remove(state::NAME) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}
