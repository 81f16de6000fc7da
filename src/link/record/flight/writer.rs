//! Writes the frames of the recorder's queue to the segments of a flight recorder, and finds the moments to keep.

use std::io;
use std::sync::Arc;

use super::folder::{self, Folder};
use super::helper::Helper;
use super::keeper::{Done, Job, Keeper};
use super::moment::{Kind, Moment, Reason};
use super::ring::{Ring, SharedRing};
use super::state::State;
use super::{AFTER, BEFORE, FlightWatch, MOMENT_MAX, SEGMENT, SEGMENTS_MIN};
use crate::link::record::blocks::{BlockWriter, Pieces};
use crate::link::record::file::Sink;
use crate::link::record::loss::Loss;
use crate::link::record::settings::Settings;
use crate::link::record::tell::tell;
use crate::link::record::writer::{Entry, FrameEntry, Writer};
use crate::recording::file_formats::ecmrec::header::HEADER_LEN;
use crate::recording::file_formats::ecmrec::section::Section;
use crate::recording::{Clock, RecordMeta};

/// The bounds of a flight recorder, bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// For the segments of the ring.
    pub ring: u64,
    /// For the recordings of kept moments.
    pub kept: u64,
}

/// Which thread runs the keeper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Help {
    Thread,
    Here,
    /// As [`Help::Here`], but nothing is synced unless [`FlightWriter::tick`] is called.
    #[cfg(test)]
    HereWithoutTicks,
}

/// The segment that grows.
struct Live {
    number: u64,
    begin_ns: u64,
    /// The frames in the order in which they come. Written bytes of this file never change, so that a power cut loses
    /// only frames that were not synced yet.
    raw: BlockWriter<FrameEntry>,
    /// The same frames, compressed. This file replaces the file of `raw` when it is complete and synced. `None` if it
    /// could not be written.
    packed: Option<BlockWriter<FrameEntry>>,
    /// The number of frames that the whole recording had lost when the segment began.
    lost_before: u64,
}

/// Writes frames to segments, and finds the moments to keep.
pub(super) struct FlightWriter {
    loss: Loss,
    name: String,
    folder: Arc<dyn Folder>,
    meta: RecordMeta,
    /// The length of a segment's file at which the next one begins, bytes.
    segment_bytes: u64,
    ring: SharedRing,
    helper: Helper,
    settings: Settings,
    watch: Box<dyn FlightWatch>,
    /// The reasons that the watch has found in the present frame.
    found: Vec<Reason>,
    live: Option<Live>,
    /// The numbers of the next segment and the next moment.
    next: u64,
    next_moment: u64,
    /// The first segment of this opening of the board.
    first: u64,
    pending: Option<Moment>,
    /// The time of the newest frame; `None` before the first one.
    newest_ns: Option<u64>,
    /// The number of lost frames that the watch knows of.
    lost_seen: u64,
    state: State,
}

impl FlightWriter {
    /// Prepares the folder: removes the unfinished files of an earlier recorder, keeps the moments that it had no time
    /// to keep, and deletes the oldest segments beyond the bound.
    pub fn begin(
        loss: Loss,
        name: &str,
        folder: Arc<dyn Folder>,
        meta: &RecordMeta,
        bounds: Bounds,
        watch: Box<dyn FlightWatch>,
        help: Help,
    ) -> io::Result<Self> {
        let (mut segments, mut moments, mut notes) = (Vec::new(), Vec::new(), Vec::new());
        for (file, bytes) in folder.list()? {
            if folder::is_unfinished(&file) {
                folder.remove(&file)?;
            } else if let Some(number) = folder::number(&file, folder::segment) {
                // A power cut may leave a file without contents.
                if bytes < HEADER_LEN as u64 { folder.remove(&file)? } else { segments.push((number, bytes)) }
            } else if let Some(number) = folder::number(&file, folder::moment) {
                moments.push((number, bytes));
            } else if let Some(number) = folder::number(&file, folder::note) {
                notes.push(number);
            }
        }
        let last = segments.iter().map(|(number, _)| *number).max().unwrap_or(0);
        let numbers = moments.iter().map(|(number, _)| *number).chain(notes.iter().copied());
        let next_moment = numbers.max().unwrap_or(0) + 1;
        notes.retain(|number| moments.iter().all(|(there, _)| there != number));
        let keeper = Keeper::new(Arc::clone(&folder), bounds.kept, moments);
        let mut helper = match help {
            Help::Thread => Helper::thread(keeper)?,
            Help::Here => Helper::here(keeper, true),
            #[cfg(test)]
            Help::HereWithoutTicks => Helper::here(keeper, false),
        };
        for number in notes {
            let name = folder::note(number);
            match Moment::parse(&folder::text(&*folder, &name, super::moment::TEXT_MAX)?) {
                Some(moment) => helper.post(Job::Keep(Moment { number, ..moment }, last)),
                None => folder.remove(&name)?,
            }
        }
        let ring = SharedRing::new(Ring::new(Arc::clone(&folder), bounds.ring, segments));
        ring.lock().make_room(0)?;
        let state = ring.with_room(|| State::begin(&*folder))?;
        Ok(Self {
            loss,
            name: name.to_owned(),
            folder,
            meta: meta.clone(),
            segment_bytes: bounds.ring / SEGMENTS_MIN,
            ring,
            helper,
            settings: Settings::new(meta.slot),
            watch,
            found: Vec::new(),
            live: None,
            next: last + 1,
            next_moment,
            first: last + 1,
            pending: None,
            newest_ns: None,
            lost_seen: 0,
            state,
        })
    }

    /// Syncs to the disk and looks for marks.
    #[cfg(test)]
    pub fn tick(&mut self) {
        self.helper.tick();
        self.look_at_helper();
    }

    fn fail(&mut self, error: &io::Error) {
        if !self.loss.has_failed() {
            self.loss.fail(error);
        }
    }

    /// Begins a segment whose first frame has the time `at_ns`.
    fn begin_segment(&mut self, at_ns: u64) -> io::Result<()> {
        let number = self.next;
        self.next += 1;
        self.ring.lock().begin(number);
        let section = Section { meta: Some(self.meta.clone()), repeated: self.settings.len() };
        let clock = self.meta.clock;
        let writer = |form, is_packed| {
            let sink = Sink::Other(Box::new(self.ring.create(number, is_packed)?));
            let mut writer = BlockWriter::begin_as(form, Loss::quiet(), sink, &section, clock)?;
            self.settings.before(at_ns).for_each(|entry| writer.push(entry));
            Ok::<_, io::Error>(writer)
        };
        let raw = writer(Pieces::Kept, false)?;
        let packed = writer(Pieces::None, true).ok();
        let lost_before = self.loss.count();
        self.live = Some(Live { number, begin_ns: at_ns, raw, packed, lost_before });
        self.helper.post(Job::Live(number));
        Ok(())
    }

    /// Ends the segment that grows.
    fn end_segment(&mut self) {
        let Some(Live { number, mut raw, packed, lost_before, .. }) = self.live.take() else { return };
        raw.flush();
        self.take_error(&mut raw);
        let lost = self.loss.count() - lost_before;
        let why = self.loss.why().to_owned();
        let end = |writer: &mut BlockWriter<FrameEntry>| {
            if lost > 0 {
                writer.loss().inherit(lost, why.clone());
            }
            writer.end();
            writer.loss().error()
        };
        let is_whole = raw.loss().error().is_none();
        let error = if is_whole { end(&mut raw) } else { None };
        let is_packed = packed.is_some_and(|mut packed| is_whole && end(&mut packed).is_none());
        if !is_packed {
            self.ring.lock().remove_packed(number);
        }
        if let Some(error) = error {
            self.fail(&io::Error::other(error));
        }
        // The file is closed before the keeper replaces it: Windows does not replace an open file.
        drop(raw);
        self.helper.post(Job::Finished { number, is_packed });
        self.look_at_helper();
    }

    /// If a write to the file of the live segment has failed, takes over the error and the number of lost frames.
    fn take_error(&mut self, raw: &mut BlockWriter<FrameEntry>) {
        if let Some(error) = raw.loss().error()
            && !self.loss.has_failed()
        {
            self.loss.add(raw.loss().count());
            self.fail(&io::Error::other(error));
        }
    }

    fn look_at_helper(&mut self) {
        for done in self.helper.done() {
            match done {
                Done::Packed(number) => self.ring.lock().is_packed(number),
                Done::Mark(text) => {
                    if let Some(at_ns) = self.newest_ns {
                        self.event(Reason { at_ns, kind: Kind::Mark, text });
                    }
                }
                Done::NotKept(why) => {
                    if self.state.is_first_not_kept(&why) {
                        tell(format!("flight recorder in {}: a moment is not kept: {why}", self.name));
                    }
                }
                Done::Failed(error) => self.fail(&error),
            }
        }
    }

    /// Handles an event: begins a moment, or extends the moment that has begun already.
    fn event(&mut self, reason: Reason) {
        if self.loss.has_failed() {
            return;
        }
        let to_ns = reason.at_ns.saturating_add(AFTER.as_nanos() as u64);
        let changed = match &mut self.pending {
            Some(moment) if to_ns.saturating_sub(moment.from_ns) <= MOMENT_MAX.as_nanos() as u64 => {
                moment.add(reason, to_ns)
            }
            _ => {
                self.finish_moment();
                let from_ns = reason.at_ns.saturating_sub(BEFORE.as_nanos() as u64);
                let segment = self.ring.lock().first_at(self.first, from_ns);
                let number = self.next_moment;
                self.next_moment += 1;
                let is_virtual = self.meta.clock == Clock::Virtual;
                self.pending =
                    Some(Moment { number, segment, from_ns, to_ns, is_virtual, reasons: vec![reason], more: 0 });
                true
            }
        };
        if changed && let Some(moment) = self.pending.clone() {
            self.helper.post(Job::Note(moment));
        }
    }

    /// Ends the moment that has begun, and gives it to the keeper with all frames so far.
    fn finish_moment(&mut self) {
        let Some(moment) = self.pending.take() else { return };
        self.end_segment();
        self.helper.post(Job::Keep(moment, self.next - 1));
    }

    /// Called before the frame with the time `at_ns` is written: ends the moment if this time is after its end, and the
    /// segment if it is long enough.
    fn end_what_is_over(&mut self, at_ns: u64) {
        if self.pending.as_ref().is_some_and(|moment| at_ns > moment.to_ns) {
            self.finish_moment();
        }
        let is_long = |live: &Live| at_ns.saturating_sub(live.begin_ns) >= SEGMENT.as_nanos() as u64;
        if self.live.as_ref().is_some_and(is_long) || self.ring.live_bytes() >= self.segment_bytes {
            self.end_segment();
        }
    }

    fn look_for_events(&mut self, entry: &FrameEntry) {
        let lost = self.loss.count();
        if std::mem::replace(&mut self.lost_seen, lost) != lost {
            self.watch.missed();
        }
        let (at_ns, found) = (entry.at_ns, &mut self.found);
        self.watch.frame(entry.dir, at_ns, &entry.frame, &mut |kind, text| found.push(Reason { at_ns, kind, text }));
        for reason in std::mem::take(&mut self.found) {
            self.event(reason);
        }
    }
}

impl Writer<FrameEntry> for FlightWriter {
    fn push(&mut self, entry: FrameEntry) {
        if self.loss.has_failed() {
            self.loss.add(1);
            return;
        }
        let at_ns = entry.at_ns();
        self.end_what_is_over(at_ns);
        if self.live.is_none()
            && let Err(error) = self.begin_segment(at_ns)
        {
            self.loss.add(1);
            self.fail(&error);
            return;
        }
        self.newest_ns = self.newest_ns.max(Some(at_ns));
        self.ring.lock().frame(at_ns);
        self.settings.look(&entry);
        if let Some(live) = &mut self.live {
            if let Some(packed) = &mut live.packed {
                packed.push(entry.clone());
            }
            live.raw.push(entry.clone());
        }
        self.look_for_events(&entry);
    }

    fn flush(&mut self) {
        if let Some(mut live) = self.live.take() {
            live.raw.flush();
            self.take_error(&mut live.raw);
            self.live = Some(live);
        }
        self.look_at_helper();
    }

    fn end(&mut self) {
        // The keeper ticks once more, so that a mark of the last second is found.
        self.helper.tick();
        self.look_at_helper();
        self.finish_moment();
        self.end_segment();
        if !self.helper.end() {
            log::warn!("the disk of {} is slow: the last moment is kept when it is recorded to again", self.name);
        }
        self.look_at_helper();
        let (missing, why) = self.loss.missing();
        // If this fails, the file `writer.txt` still says that the recording was not ended.
        let _ = self.state.end(&*self.folder, missing, why.as_deref());
    }

    fn loss(&mut self) -> &mut Loss {
        &mut self.loss
    }
}
