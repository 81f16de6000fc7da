//! The work of a flight recorder besides writing frames: it syncs files to the disk, replaces uncompressed segments by
//! compressed ones, keeps moments, and finds marks. On the real clock a thread of its own does this work, because a
//! disk may take seconds for it, for which frames would have to wait.

use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::folder::{self, Folder, Output};
use super::moment::{self, Kind, Moment, one_line};
use crate::link::record::blocks::{BlockWriter, Pieces};
use crate::link::record::file::Sink;
use crate::link::record::loss::Loss;
use crate::link::record::settings::Settings;
use crate::link::record::writer::{FrameEntry, Writer};
use crate::recording::file_formats::ecmrec::header::{HEADER_LEN, Header};
use crate::recording::file_formats::ecmrec::section::Section;
use crate::recording::{RecordMeta, Recorded, Recording};

/// The extension of the file of a mark.
pub(super) const MARK: &str = ".mark";
/// The most bytes at the beginning of a segment that are read to find how many of its frames repeat earlier ones: more
/// than its first block has. \[OURS]
const BEGIN_MAX: usize = 128 * 1024;

/// Why frames are missing at the beginning of a moment if the ring has already deleted the first segments. The number
/// of these frames is not known.
const BEGIN_MISSING: &str =
    "and more, at the beginning: the ring had no room for them any more; give it a larger flight_bytes=";

/// A job that the recorder's thread gives to the keeper.
pub(super) enum Job {
    /// The segment with this number grows from now on, so it has to be synced at each tick.
    Live(u64),
    /// A segment is finished. `is_packed`: its compressed form exists, and has to replace the uncompressed file.
    Finished { number: u64, is_packed: bool },
    /// A moment has begun or has got another reason, so its text has to be written.
    Note(Moment),
    /// A moment has to be copied to a recording of its own. All its frames are in finished segments; the number is that
    /// of the last one.
    Keep(Moment, u64),
}

/// A result that the keeper reports to the recorder's thread.
pub(super) enum Done {
    /// The compressed form of the segment with this number has replaced the uncompressed file.
    Packed(u64),
    /// A person has marked the present moment, with this text.
    Mark(String),
    /// A moment cannot be kept, for this reason.
    NotKept(String),
    /// The ring cannot be synced to the disk.
    Failed(io::Error),
}

/// A kept moment, whose recording is complete.
struct Kept {
    bytes: u64,
    rank: Option<Kind>,
}

/// Does the work of a flight recorder besides writing frames; see the description of this module.
pub(super) struct Keeper {
    folder: Arc<dyn Folder>,
    bound: u64,
    /// The segment that grows, which is synced at each tick.
    live: Option<u64>,
    kept: BTreeMap<u64, Kept>,
}

impl Keeper {
    /// `bound`: the most bytes of all kept moments. `kept`: the numbers of the moments that exist already, with the
    /// lengths of their recordings.
    pub fn new(folder: Arc<dyn Folder>, bound: u64, kept: Vec<(u64, u64)>) -> Self {
        let of = |(number, bytes)| (number, Kept { bytes, rank: rank(&*folder, number) });
        let kept = kept.into_iter().map(of).collect();
        Self { folder, bound, live: None, kept }
    }

    /// Does one job.
    pub fn work(&mut self, job: Job, done: &mut dyn FnMut(Done)) {
        match job {
            Job::Live(number) => self.live = Some(number),
            Job::Finished { number, is_packed } => {
                if self.live == Some(number) {
                    self.live = None;
                }
                match self.finish(number, is_packed) {
                    Ok(()) if is_packed => done(Done::Packed(number)),
                    Ok(()) => {}
                    // The ring has deleted the segment meanwhile.
                    Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                    Err(error) => done(Done::Failed(error)),
                }
            }
            Job::Note(moment) => {
                if let Err(error) = self.put_note(&moment) {
                    done(Done::NotKept(error.to_string()));
                }
            }
            Job::Keep(moment, last) => {
                if let Err(error) = self.keep(&moment, last) {
                    let _ = self.folder.remove(&folder::unfinished(moment.number));
                    done(Done::NotKept(error.to_string()));
                }
            }
        }
    }

    /// Syncs the growing segment to the disk, and looks for marks. Called once a second.
    pub fn tick(&self, done: &mut dyn FnMut(Done)) {
        if self.sync(done) {
            self.look_for_marks(done);
        }
    }

    /// Syncs the growing segment to the disk. Returns whether that has succeeded.
    pub fn sync(&self, done: &mut dyn FnMut(Done)) -> bool {
        let live = self.live.map(folder::segment);
        // The contents are synced before the names. So a name on the disk never belongs to a file with less contents
        // than at the last sync.
        let synced = live.map_or(Ok(()), |name| self.folder.sync(&name)).and_then(|()| self.folder.sync_names());
        synced.map_err(|error| done(Done::Failed(error))).is_ok()
    }

    fn look_for_marks(&self, done: &mut dyn FnMut(Done)) {
        // If the folder cannot be listed, no mark is found. Syncing reports an error of the folder.
        for (name, _) in self.folder.list().unwrap_or_default() {
            if name.ends_with(MARK) && !name.contains('/') {
                let text = folder::text(&*self.folder, &name, moment::MARK_MAX as u64);
                // A mark that cannot be removed is ignored: it would come again with each tick.
                if self.folder.remove(&name).is_ok()
                    && let Ok(text) = text
                {
                    done(Done::Mark(one_line(&text)));
                }
            }
        }
    }

    fn finish(&self, number: u64, is_packed: bool) -> io::Result<()> {
        let name = folder::segment(number);
        if !is_packed {
            self.folder.sync(&name)?;
            return self.folder.sync_names();
        }
        // The compressed form is synced before it replaces the uncompressed file, so that a power cut cannot lose both.
        let packed = folder::packed(number);
        self.folder.sync(&packed)?;
        self.folder.rename(&packed, &name)?;
        self.folder.sync_names()
    }

    fn put_note(&self, moment: &Moment) -> io::Result<()> {
        folder::put_text(&*self.folder, &folder::note(moment.number), &moment.to_string())?;
        self.folder.sync_names()
    }

    /// Copies the frames of a moment from the ring to a recording of their own.
    fn keep(&mut self, moment: &Moment, last: u64) -> io::Result<()> {
        let numbered = |(name, bytes): (String, u64)| Some((folder::number(&name, folder::segment)?, bytes));
        let mut segments: BTreeMap<u64, u64> = self.folder.list()?.into_iter().filter_map(numbered).collect();
        segments.retain(|number, _| (moment.segment..=last).contains(number));
        if !self.make_room(segments.values().sum(), moment)? {
            return Ok(());
        }
        self.put_note(moment)?;
        let unfinished = folder::unfinished(moment.number);
        let mut copy = Copy::new(moment, self.folder.create(&unfinished)?);
        // The ring may have deleted the first segments already.
        copy.is_begin_missing = !segments.contains_key(&moment.segment);
        for number in segments.into_keys() {
            match self.folder.open(&folder::segment(number)) {
                Ok(file) => copy.segment(file)?,
                Err(error) if error.kind() == io::ErrorKind::NotFound => copy.is_begin_missing = true,
                Err(error) => return Err(error),
            }
        }
        let Some(bytes) = copy.end()? else {
            self.forget(moment.number)?;
            return Err(io::Error::new(io::ErrorKind::NotFound, "the ring has no frame of it any more"));
        };
        self.folder.sync(&unfinished)?;
        self.folder.rename(&unfinished, &folder::moment(moment.number))?;
        self.folder.sync_names()?;
        self.kept.insert(moment.number, Kept { bytes, rank: moment.rank() });
        Ok(())
    }

    /// Deletes kept moments until the new one has room: those of the lowest rank first, and of these the oldest. If the
    /// moments of a higher rank leave no room for the new one, deletes none of them and returns false: the new moment
    /// is not kept. \[OURS]
    fn make_room(&mut self, bytes: u64, moment: &Moment) -> io::Result<bool> {
        if bytes > self.bound {
            let what = format!("{bytes} bytes have no room; give moments a larger flight_kept_bytes=");
            return Err(io::Error::new(io::ErrorKind::QuotaExceeded, what));
        }
        let sum = |kept: &BTreeMap<u64, Kept>, is_counted: &dyn Fn(&Kept) -> bool| -> u64 {
            kept.values().filter(|kept| is_counted(kept)).map(|kept| kept.bytes).sum()
        };
        let rank = moment.rank();
        if sum(&self.kept, &|kept| kept.rank > rank) + bytes > self.bound {
            self.forget(moment.number)?;
            return Ok(false);
        }
        while sum(&self.kept, &|_| true) + bytes > self.bound {
            let least = self.kept.iter().min_by_key(|(number, kept)| (kept.rank, **number));
            let Some(number) = least.map(|(number, _)| *number) else { return Ok(true) };
            self.forget(number)?;
            self.kept.remove(&number);
        }
        Ok(true)
    }

    /// Removes the files of a moment.
    fn forget(&self, number: u64) -> io::Result<()> {
        for name in [folder::moment(number), folder::note(number)] {
            match self.folder.remove(&name) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => {}
            }
        }
        Ok(())
    }
}

/// The rank of a kept moment, read from its text; `None` if there is no valid text.
fn rank(folder: &dyn Folder, number: u64) -> Option<Kind> {
    Moment::parse(&folder::text(folder, &folder::note(number), moment::TEXT_MAX).ok()?)?.rank()
}

/// Copies frames of a moment from segments to its recording.
struct Copy<'a> {
    moment: &'a Moment,
    /// The file of the recording, until `writer` takes it over at the first frame.
    output: Option<Box<dyn Output>>,
    length: Arc<AtomicU64>,
    writer: Option<BlockWriter<FrameEntry>>,
    meta: Option<RecordMeta>,
    settings: Settings,
    missing: u64,
    /// Whether a segment was not ended, is damaged, or cannot be read to its end.
    is_cut: bool,
    /// Whether the ring has deleted the first segments.
    is_begin_missing: bool,
}

impl<'a> Copy<'a> {
    fn new(moment: &'a Moment, output: Box<dyn Output>) -> Self {
        Self {
            moment,
            output: Some(output),
            length: Arc::default(),
            writer: None,
            meta: None,
            settings: Settings::default(),
            missing: 0,
            is_cut: false,
            is_begin_missing: false,
        }
    }

    /// Copies those frames of a segment that belong to the moment.
    fn segment(&mut self, file: impl Read) -> io::Result<()> {
        let mut file = BufReader::with_capacity(BEGIN_MAX, file);
        let repeated = repeated(file.fill_buf()?);
        let Ok(mut recording) = Recording::new(file, "") else {
            self.is_cut = true;
            return Ok(());
        };
        if let Some(meta) = recording.meta().filter(|_| self.meta.is_none()) {
            self.settings = Settings::new(meta.slot);
            self.meta = Some(meta.clone());
        }
        for (place, recorded) in (0..).zip(&mut recording) {
            let Ok(Recorded { at_ns, dir, frame, .. }) = recorded else {
                self.is_cut = true;
                break;
            };
            let entry = FrameEntry { at_ns, dir, frame: *frame };
            if self.writer.is_none() && (place < repeated || at_ns < self.moment.from_ns) {
                self.settings.look(&entry);
            } else if place >= repeated && at_ns <= self.moment.to_ns {
                self.push(entry)?;
            }
        }
        let lacks = recording.lacks();
        self.missing += lacks.missing;
        self.is_cut |= lacks.not_ended > 0 || lacks.damage.count > 0;
        Ok(())
    }

    fn push(&mut self, entry: FrameEntry) -> io::Result<()> {
        if let (Some(output), Some(meta)) = (self.output.take(), &self.meta) {
            let sink = Sink::Other(Box::new(Counted { output, length: Arc::clone(&self.length) }));
            let section = Section { meta: Some(meta.clone()), repeated: self.settings.len() };
            let mut writer = BlockWriter::begin_as(Pieces::None, Loss::quiet(), sink, &section, meta.clock)?;
            self.settings.before(entry.at_ns).for_each(|entry| writer.push(entry));
            self.writer = Some(writer);
        }
        let Some(writer) = &mut self.writer else { return Ok(()) };
        writer.push(entry);
        check(writer)
    }

    /// Ends the recording; returns its length in bytes, or `None` if it has no frame.
    fn end(mut self) -> io::Result<Option<u64>> {
        let Some(writer) = &mut self.writer else { return Ok(None) };
        if self.is_begin_missing {
            // The number of frames in the deleted segments is unknown; it was at least one.
            writer.loss().inherit(self.missing + 1, BEGIN_MISSING.to_owned());
        } else if self.missing > 0 {
            writer.loss().inherit(self.missing, "they were missing in the ring".to_owned());
        }
        if self.is_cut {
            writer.write_all_blocks();
        } else {
            writer.end();
        }
        check(writer)?;
        Ok(Some(self.length.load(Ordering::Relaxed)))
    }
}

fn check(writer: &mut BlockWriter<FrameEntry>) -> io::Result<()> {
    writer.loss().error().map_or(Ok(()), |error| Err(io::Error::other(error)))
}

/// How many frames at the beginning of a segment repeat earlier ones.
fn repeated(begin: &[u8]) -> u32 {
    let section = Header::parse(begin)
        .and_then(|header| begin.get(HEADER_LEN..HEADER_LEN + header.length as usize))
        .and_then(Section::parse);
    section.map_or(0, |section| section.repeated)
}

/// A file whose bytes are counted.
struct Counted {
    output: Box<dyn Output>,
    length: Arc<AtomicU64>,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.output.append(bytes)?;
        self.length.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
