//! Finds the recordings of a folder and sorts them by time.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use ecmsk::link::record::flight::FlightContents;
use ecmsk::recording::{Address, Clock, Lacks, RecordError};
use ecmsk::sk::SlotSize;

use crate::recording::{Frames, board};

/// A recording, with its begin.
#[derive(Clone, Debug)]
pub struct Source {
    pub file: PathBuf,
    /// The USB address of the board in a capture.
    pub device: Option<Address>,
    /// The time of the first frame, ns.
    pub begin_ns: u64,
    /// Whether the times are those of a virtual clock. Otherwise they are relative to 1970-01-01, UTC.
    pub is_virtual: bool,
    /// Whether the file is the segment of a flight recorder that a process is writing at present.
    pub is_live: bool,
}

/// The result of a search for recordings.
#[derive(Debug, Default)]
pub struct Sources {
    /// The recordings, oldest first.
    pub recordings: Vec<Source>,
    /// The files that are skipped, each with the reason: it is no recording of a board, or cannot be read.
    pub passed_over: Vec<(PathBuf, String)>,
    /// The skipped files that are damaged recordings, as their content or their name shows.
    pub damaged: Vec<PathBuf>,
}

/// The options of the user for reading captures.
#[derive(Clone, Copy, Debug)]
pub struct About {
    pub size: Option<SlotSize>,
    pub device: Option<Address>,
}

impl Sources {
    /// The recordings of a folder. In the folder of a flight recorder these are its segments, and the kept moments
    /// older than the segments. In any other folder these are all recordings and captures, without subfolders.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn of(folder: &Path, about: About) -> io::Result<Self> {
        match FlightContents::of(folder) {
            Ok(flight) => Ok(Self::of_flight(&flight, about)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Self::of_files(folder, about),
            Err(error) => Err(error),
        }
    }

    /// The single recording of a file.
    pub fn of_file(file: &Path, about: About) -> Result<Self, RecordError> {
        let mut sources = Self::default();
        match source(file, about)? {
            Ok(source) => sources.recordings.push(source),
            Err(empty) => sources.pass_over_empty(file, empty),
        }
        Ok(sources)
    }

    fn of_flight(flight: &FlightContents, about: About) -> Self {
        let mut sources = Self::default();
        let oldest_ns = flight.segments.iter().find_map(|segment| segment.times_ns).map_or(u64::MAX, |times| times.0);
        // Moments that are also in the segments must not be counted twice.
        let older = flight.moments.iter().filter(|kept| kept.moment.to_ns < oldest_ns);
        for file in older.filter_map(|kept| kept.file.as_ref()) {
            sources.add(file, about);
        }
        for segment in &flight.segments {
            sources.add(&segment.file, about);
        }
        if let Some((last, newest)) = sources.recordings.last_mut().zip(flight.segments.last()) {
            last.is_live = flight.writer.is_some() && last.file == newest.file;
        }
        sources
    }

    fn of_files(folder: &Path, about: About) -> io::Result<Self> {
        let mut files: Vec<PathBuf> = Vec::new();
        for entry in fs::read_dir(folder)? {
            files.push(entry?.path());
        }
        files.sort();
        let mut sources = Self::default();
        for file in files {
            match fs::metadata(&file) {
                Ok(metadata) if metadata.is_file() => sources.add(&file, about),
                Ok(metadata) if metadata.is_dir() => sources.pass_over(&file, "it is a folder; name it for its trends"),
                // Other types are skipped: opening a pipe, for example, would block until someone writes to it.
                Ok(_) => sources.pass_over(&file, "it is no file"),
                Err(error) => sources.pass_over(&file, error),
            }
        }
        if sources.recordings.iter().all(|source| !source.is_virtual) {
            sources.recordings.sort_by_key(|source| source.begin_ns);
        }
        Ok(sources)
    }

    fn add(&mut self, file: &Path, about: About) {
        match source(file, about) {
            Ok(Ok(source)) => self.recordings.push(source),
            Ok(Err(empty)) => self.pass_over_empty(file, empty),
            Err(error) => self.pass_over_unread(file, error),
        }
    }

    /// Skips a recording that has no frame.
    fn pass_over_empty(&mut self, file: &Path, lacks: Option<Lacks>) {
        if lacks.is_some() {
            self.damaged.push(file.to_owned());
        }
        self.pass_over(file, lacks.map_or_else(|| "it has no frame".to_owned(), |lacks| lacks.to_string()));
    }

    /// Skips a file that cannot be read. It counts as a damaged recording if its content or its name is that of a
    /// recording.
    pub fn pass_over_unread(&mut self, file: &Path, error: RecordError) {
        let is_named_so =
            file.extension().is_some_and(|ending| ["ecmrec", "pcapng", "pcap"].map(OsStr::new).contains(&ending));
        if is_named_so || !matches!(error, RecordError::NotACapture { .. }) {
            self.damaged.push(file.to_owned());
        }
        self.pass_over(file, error);
    }

    /// Skips a file, for the reason `why`.
    pub fn pass_over(&mut self, file: &Path, why: impl ToString) {
        let why = why.to_string();
        // Messages of a reader begin with the name of the file. It is removed here, because the output names the file
        // anyway.
        let name = file.display().to_string();
        let rest = why.strip_prefix(&name).map(|rest| rest.trim_start_matches([':', ' '])).unwrap_or(&why);
        self.passed_over.push((file.to_owned(), rest.to_owned()));
    }
}

/// Reads the beginning of a recording. If there is no readable frame, returns what the recording lacks.
fn source(file: &Path, about: About) -> Result<Result<Source, Option<Lacks>>, RecordError> {
    let device = board(file, about.device)?;
    let mut frames = Frames::open(file, about.size, device)?.quiet();
    let Some(first) = frames.next().transpose()? else {
        return Ok(Err(frames.lacks()));
    };
    let is_virtual = first.meta.is_some_and(|meta| meta.clock == Clock::Virtual);
    Ok(Ok(Source { file: file.to_owned(), device, begin_ns: first.recorded.at_ns, is_virtual, is_live: false }))
}

impl Source {
    /// Whether a process is writing to the file at present. If the system does not show this, the answer is no.
    pub fn is_growing(&self) -> bool {
        // On systems where a lock would prevent reading, a recording (`record=`) is not locked, so a lock shows nothing
        // there.
        if self.is_live || !cfg!(unix) {
            return self.is_live;
        }
        let Ok(file) = File::open(&self.file) else { return false };
        let locked = file.try_lock_shared();
        let _ = file.unlock();
        matches!(locked, Err(TryLockError::WouldBlock))
    }
}
