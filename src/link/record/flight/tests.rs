//! Flight recorders in a folder in memory ([`memory`]). Times are those of the frames, not of the machine.

mod memory;
mod odd;

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::folder;
use super::keeper::MARK;
use super::moment::{Kind, Moment, Reason};
use super::state::State;
use super::writer::{Bounds, FlightWriter, Help};
use super::{AFTER, BEFORE, FlightWatch};
use crate::link::record::loss::Loss;
use crate::link::record::writer::{FrameEntry, Writer};
use crate::link::{Dir, Stamp};
use crate::recording::file_formats::ecmrec::header::{HEADER_LEN, Header};
use crate::recording::file_formats::ecmrec::section::Section;
use crate::recording::{Clock, Lacks, RecordMeta, Recording};
use crate::sk::{Frame, MasterCommand, MasterState, SlaveKind, SlotSize, StateByte};
use memory::{Dice, Memory, after_cut};

/// The time between two frames, ns.
const STEP_NS: u64 = 100_000_000;
const FRAMES_A_SECOND: u64 = 1_000_000_000 / STEP_NS;
const BEGIN_NS: u64 = 1_700_000_000_000_000_000;
const LARGE: Bounds = Bounds { ring: 100_000_000, kept: 100_000_000 };
const SMALL: Bounds = Bounds { ring: 60_000, kept: 40_000 };
/// The offset at which a frame of these tests has its number.
const NUMBER_AT: usize = 100;

fn meta() -> RecordMeta {
    RecordMeta { slot: Some(SlotSize::Bytes12), ..RecordMeta::begun("sim:".to_owned(), None, false, Stamp(0)) }
}

/// Finds an event in each frame with one of these numbers.
struct At(BTreeMap<u64, Kind>, Arc<AtomicU64>);

impl FlightWatch for At {
    fn frame(&mut self, _: Dir, _: u64, frame: &Frame, found: &mut dyn FnMut(Kind, String)) {
        if let Some(kind) = self.0.get(&number_of(frame)) {
            found(*kind, format!("event {}", number_of(frame)));
        }
    }

    fn missed(&mut self) {
        self.1.fetch_add(1, Ordering::Relaxed);
    }
}

/// A flight recorder and its frames.
struct Recorder {
    memory: Memory,
    writer: FlightWriter,
    dropped: Arc<AtomicU64>,
    missed: Arc<AtomicU64>,
    dice: Dice,
    next: u64,
    begin_ns: u64,
}

impl Recorder {
    fn begin(memory: &Memory, bounds: Bounds, events: &[(u64, Kind)]) -> Self {
        let (dropped, missed) = (Arc::<AtomicU64>::default(), Arc::<AtomicU64>::default());
        let loss = Loss::new("flight".to_owned(), Arc::clone(&dropped));
        let watch = Box::new(At(events.iter().copied().collect(), Arc::clone(&missed)));
        let folder = Arc::new(memory.clone());
        let writer = FlightWriter::begin(loss, "flight", folder, &meta(), bounds, watch, Help::HereWithoutTicks);
        let writer = writer.expect("the folder takes it");
        Self { memory: memory.clone(), writer, dropped, missed, dice: Dice(bounds.ring), next: 0, begin_ns: BEGIN_NS }
    }

    fn at_ns(&self, number: u64) -> u64 {
        self.begin_ns + number * STEP_NS
    }

    fn put(&mut self, dir: Dir, frame: Frame) {
        self.put_at(self.at_ns(self.next), dir, frame);
    }

    fn put_at(&mut self, at_ns: u64, dir: Dir, mut frame: Frame) {
        let number = self.next;
        self.next += 1;
        self.memory.with(|inside| inside.frame = number);
        frame.bytes_mut()[NUMBER_AT..NUMBER_AT + 8].copy_from_slice(&number.to_le_bytes());
        self.writer.push(FrameEntry { at_ns, dir, frame });
        if self.dice.below(3) > 0 {
            self.writer.flush();
        }
        if self.next.is_multiple_of(FRAMES_A_SECOND) {
            self.writer.flush();
            self.writer.tick();
        }
    }

    /// Records frames that differ from all others in a few bytes.
    fn frames(&mut self, count: u64) {
        for _ in 0..count {
            let mut frame = Frame::new();
            let noise = self.dice.below(1 << 30) as u32;
            frame.bytes_mut()[200..204].copy_from_slice(&noise.to_le_bytes());
            self.put(Dir::Write, frame);
        }
    }

    /// Records a report of a board in OP with this time.
    fn report_at(&mut self, at_ns: u64) {
        let mut frame = Frame::new();
        frame.bytes_mut()[2] = StateByte::reached(MasterState::Op).0;
        self.put_at(at_ns, Dir::Read, frame);
    }

    fn command(&mut self, command: &MasterCommand) {
        let mut frame = Frame::new();
        frame.put_master(SlotSize::Bytes12, command);
        self.put(Dir::Write, frame);
    }

    fn end(mut self) -> (u64, State) {
        self.writer.flush();
        self.writer.end();
        (self.dropped.load(Ordering::Relaxed), State::read(&self.memory).unwrap_or_default())
    }
}

fn set_axis() -> MasterCommand {
    MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] }
}

fn number_of(frame: &Frame) -> u64 {
    u64::from_le_bytes(frame.bytes()[NUMBER_AT..NUMBER_AT + 8].try_into().unwrap())
}

/// The frames of a recording, their times and numbers, and what it lacks. `None` if not even its beginning is there.
fn read(bytes: &[u8]) -> Option<(Vec<(u64, u64)>, Lacks)> {
    let mut recording = Recording::new(bytes, "").ok()?;
    // Where not even the first block can be read, frames are an error.
    let frames = recording.by_ref().map_while(Result::ok);
    let frames = frames.map(|recorded| (recorded.at_ns, number_of(&recorded.frame))).collect();
    Some((frames, recording.lacks()))
}

/// How many frames at the beginning of a recording repeat earlier ones; `None` if a power cut has damaged its beginning.
fn repeated(bytes: &[u8]) -> Option<usize> {
    let header = Header::parse(bytes)?;
    let section = Section::parse(bytes.get(HEADER_LEN..HEADER_LEN + header.length as usize)?)?;
    Some(section.repeated as usize)
}

/// The numbers of the frames of all segments, in the order of their names, and the sum of what they lack.
fn ring(files: &BTreeMap<String, Vec<u8>>) -> (Vec<u64>, u64) {
    let (mut numbers, mut missing) = (Vec::new(), 0);
    for (_, bytes) in files.iter().filter(|(name, _)| folder::number(name, folder::segment).is_some()) {
        if let (Some((frames, lacks)), Some(repeated)) = (read(bytes), repeated(bytes)) {
            numbers.extend(frames.iter().skip(repeated).map(|(_, number)| *number));
            missing += lacks.missing;
        }
    }
    (numbers, missing)
}

/// The frames of a kept moment without its repeated settings, and its text.
fn moment(files: &BTreeMap<String, Vec<u8>>, number: u64) -> Option<(Vec<u64>, Moment)> {
    let bytes = files.get(&folder::moment(number))?;
    let (frames, _) = read(bytes)?;
    assert!(frames.is_sorted_by_key(|(at_ns, _)| *at_ns));
    let numbers = frames.iter().skip(repeated(bytes)?).map(|(_, number)| *number).collect();
    let text = String::from_utf8(files[&folder::note(number)].clone()).unwrap();
    Some((numbers, Moment::parse(&text).unwrap()))
}

/// All frames are in the ring, in order, compressed, and every segment begins with the settings of the board.
#[test]
fn the_ring_has_all_frames() {
    let memory = Memory::default();
    let mut recorder = Recorder::begin(&memory, LARGE, &[]);
    recorder.command(&set_axis());
    recorder.frames(2000);
    let (missing, state) = recorder.end();
    assert_eq!((missing, state.lacks()), (0, None));
    let files = memory.files();
    assert!(ring(&files).0.into_iter().eq(0..=2000));
    let segments: Vec<_> = files.iter().filter(|(name, _)| name.starts_with("segment-")).collect();
    assert_eq!(segments.len(), 7, "30 s each");
    for (name, bytes) in segments {
        let (frames, lacks) = read(bytes).unwrap();
        assert!(lacks.is_nothing() && frames[0].1 == 0, "{name}: {lacks}");
        assert!(bytes.len() < 40 * frames.len(), "{name}: {} bytes", bytes.len());
    }
}

/// The power is cut at random moments, a thousand times: all frames but those of the last second can be read from the
/// disk. A recorder that is started afterwards keeps the moments that had begun.
#[test]
fn a_power_cut_costs_a_second() {
    const FRAMES: u64 = 900;
    const EVENT: u64 = 500;
    for (bounds, seeds) in [(LARGE, 500), (SMALL, 500)] {
        let memory = Memory::default();
        let mut recorder = Recorder::begin(&memory, bounds, &[(EVENT, Kind::Alarm)]);
        recorder.command(&set_axis());
        recorder.frames(FRAMES);
        recorder.end();
        let log = memory.with(|inside| std::mem::take(&mut inside.log));
        for seed in 0..seeds {
            let mut dice = Dice(seed);
            let at = dice.below(log.len() as u64) as usize;
            let frame = log[at].0;
            let files = after_cut(&log, at, &mut dice);
            let (numbers, _) = ring(&files);
            let first = numbers.first().copied().unwrap_or(0);
            assert!(numbers.iter().copied().eq(first..first + numbers.len() as u64), "{seed}: {numbers:?}");
            let synced = frame.saturating_sub(FRAMES_A_SECOND);
            assert!(
                synced == 0 || numbers.last().is_some_and(|last| *last + 1 >= synced),
                "{seed}: {frame} {numbers:?}"
            );
            assert!(first == 0 || bounds.ring == SMALL.ring, "{seed}: {first}");
            if seed % 5 == 0 {
                let again = Memory::of(files);
                let mut recorder = Recorder::begin(&again, bounds, &[]);
                recorder.frames(20);
                assert_eq!(recorder.end().1.lacks(), None, "{seed}");
                let files = again.files();
                assert!(files.keys().all(|name| !name.ends_with(".tmp") && !name.ends_with(".packed")), "{seed}");
                if frame > EVENT + FRAMES_A_SECOND && bounds.ring == LARGE.ring {
                    let (numbers, text) = moment(&files, 1).unwrap_or_else(|| panic!("{seed}: {frame}"));
                    let last = (EVENT + AFTER.as_secs() * FRAMES_A_SECOND).min(synced - 1);
                    let first = EVENT - BEFORE.as_secs() * FRAMES_A_SECOND;
                    assert!(numbers.iter().copied().eq(first..first + numbers.len() as u64), "{seed}: {numbers:?}");
                    assert!(*numbers.last().unwrap() >= last, "{seed}: {frame} {numbers:?}");
                    assert_eq!(text.reasons[0].text, format!("event {EVENT}"));
                }
            }
        }
    }
}

/// The ring and the kept moments never take more than their bounds; the newest frames are there.
#[test]
fn bounds_hold_at_any_time() {
    let memory = Memory::default();
    memory.with(|inside| inside.bounds = Some(SMALL));
    let events: Vec<_> = (1..20).map(|n| (n * 450, Kind::Alarm)).collect();
    let mut recorder = Recorder::begin(&memory, SMALL, &events);
    recorder.frames(10_000);
    let (missing, state) = recorder.end();
    assert_eq!((missing, state.lacks()), (0, None));
    let files = memory.files();
    let (numbers, _) = ring(&files);
    let first = numbers[0];
    assert!(first > 1000 && numbers.len() > 500 && numbers.into_iter().eq(first..10_000), "{first}");
    assert!(!files.contains_key(&folder::moment(1)) && !files.contains_key(&folder::note(1)), "the oldest are gone");
    assert!(moment(&files, 19).is_some());
}

/// The frames around an event are kept: from 30 s before it to 10 s after it, with the settings that were made long
/// before. Events close to each other are one moment.
#[test]
fn what_surrounds_an_event_is_kept() {
    let memory = Memory::default();
    let events = [(1000, Kind::Alarm), (1050, Kind::FollowingError), (2000, Kind::Gap)];
    let mut recorder = Recorder::begin(&memory, LARGE, &events);
    recorder.command(&set_axis());
    recorder.frames(2100);
    let at_ns = |number| recorder.at_ns(number);
    let whole = [at_ns(1000), at_ns(1050), at_ns(2000)];
    assert_eq!(recorder.end().1.lacks(), None);
    let files = memory.files();
    let (numbers, text) = moment(&files, 1).unwrap();
    assert!(numbers.into_iter().eq(700..=1150));
    let reason = |at_ns, kind, number: u64| Reason { at_ns, kind, text: format!("event {number}") };
    let reasons = vec![reason(whole[0], Kind::Alarm, 1000), reason(whole[1], Kind::FollowingError, 1050)];
    assert_eq!(text.reasons, reasons);
    let (frames, lacks) = read(&files[&folder::moment(1)]).unwrap();
    assert!(lacks.is_nothing(), "{lacks}");
    assert_eq!(frames[0], (frames[1].0 - 64_000_000, 0), "SET_AXIS is 64 cycles before the first frame");
    // The recording ends before the moment would.
    let (numbers, text) = moment(&files, 2).unwrap();
    assert!(numbers.into_iter().eq(1700..=2100));
    assert_eq!(text.reasons, [reason(whole[2], Kind::Gap, 2000)]);
    assert_eq!(moment(&files, 3), None);
}

/// Reports at the beginning of a segment, even if they were read late, come after the settings: in the file, and for
/// readers, which sort by time. A moment over several segments has its settings and all its frames.
#[test]
fn reports_stay_behind_the_settings() {
    const LATE_NS: u64 = 31_000_000;
    const EVENT: u64 = 700;
    let memory = Memory::default();
    let mut recorder = Recorder::begin(&memory, LARGE, &[(EVENT, Kind::Alarm)]);
    recorder.command(&set_axis());
    for number in 1..=1000 {
        // Segments begin with frames 300, 600 and so on. The report after such a frame is older than the frame.
        let is_late = number > 1 && number % 300 == 1;
        let at_ns = if is_late { recorder.at_ns(number - 1) - LATE_NS } else { recorder.at_ns(number) };
        recorder.report_at(at_ns);
    }
    assert_eq!(recorder.end().1.lacks(), None);
    let files = memory.files();
    for number in 2..=4 {
        let (frames, _) = read(&files[&folder::segment(number)]).unwrap();
        let is_first = frames.iter().skip(1).all(|(at_ns, _)| *at_ns > frames[0].0);
        assert!(frames[0].1 == 0 && is_first, "segment {number}: {:?}", &frames[..3]);
    }
    let (mut numbers, _) = ring(&files);
    numbers.sort_unstable();
    assert!(numbers.into_iter().eq(0..=1000));
    let (mut numbers, _) = moment(&files, 1).unwrap();
    numbers.sort_unstable();
    assert!(numbers.iter().copied().eq(EVENT - 300..=EVENT + 100), "{numbers:?}");
    let (frames, _) = read(&files[&folder::moment(1)]).unwrap();
    assert_eq!(frames[0].1, 0, "SET_AXIS");
}

/// If kept moments have no room, moments of gaps are deleted before those of alarms, and marks last.
#[test]
fn the_least_moments_go_first() {
    let memory = Memory::default();
    let events = [(400, Kind::Alarm), (900, Kind::Gap), (1400, Kind::Alarm), (1900, Kind::Gap)];
    let mut recorder = Recorder::begin(&memory, LARGE, &events);
    recorder.frames(2400);
    recorder.end();
    let bytes = memory.files()[&folder::moment(1)].len() as u64;
    let memory = Memory::default();
    // While it is copied, a moment may be as long as its segments.
    let bounds = Bounds { kept: bytes * 4, ..LARGE };
    memory.with(|inside| inside.bounds = Some(bounds));
    let mut recorder = Recorder::begin(&memory, bounds, &events);
    recorder.frames(2400);
    assert_eq!(recorder.end().1.lacks(), None);
    let kept: BTreeSet<_> = memory.files().keys().filter_map(|name| folder::number(name, folder::moment)).collect();
    assert!(kept.contains(&1) && kept.contains(&3) && !kept.contains(&2), "{kept:?}");
}

/// A person's mark is found during the recording, and its text is kept.
#[test]
fn a_mark_is_kept() {
    let memory = Memory::default();
    let mut recorder = Recorder::begin(&memory, LARGE, &[]);
    recorder.frames(500);
    let mark = format!("1-2{MARK}");
    folder::put_text(&memory, &mark, "a noise\nat the left axis\x1b").unwrap();
    recorder.frames(500);
    recorder.end();
    let files = memory.files();
    assert!(!files.contains_key(&mark));
    let (numbers, text) = moment(&files, 1).unwrap();
    assert_eq!((numbers[0], *numbers.last().unwrap()), (509 - 300, 609));
    assert_eq!((text.reasons[0].kind, &*text.reasons[0].text), (Kind::Mark, "a noise at the left axis"));
}

/// A full disk costs the oldest segments and no new frame.
#[test]
fn a_full_disk_thins_the_ring() {
    let memory = Memory::default();
    memory.with(|inside| inside.capacity = Some(80_000));
    let bounds = Bounds { ring: 1_000_000, ..LARGE };
    let mut recorder = Recorder::begin(&memory, bounds, &[]);
    recorder.frames(20_000);
    let (missing, state) = recorder.end();
    assert_eq!((missing, state.lacks()), (0, None));
    let (numbers, _) = ring(&memory.files());
    let first = numbers[0];
    assert!(first > 0 && numbers.into_iter().eq(first..20_000), "{first}");
}

/// A disk that vanishes or becomes read-only ends the recording. All frames that are not in it are counted.
#[test]
fn a_disk_that_fails_ends_the_recording() {
    for (error, at) in [
        (io::ErrorKind::ReadOnlyFilesystem, 950),
        (io::ErrorKind::NotFound, 955),
        (io::ErrorKind::StorageFull, 1000),
        (io::ErrorKind::Other, 0),
    ] {
        let memory = Memory::default();
        let mut recorder = Recorder::begin(&memory, LARGE, &[(940, Kind::Alarm), (1100, Kind::Alarm)]);
        recorder.frames(at);
        memory.with(|inside| inside.error = Some(error));
        recorder.frames(1500 - at);
        let writer = &mut recorder.writer;
        assert!(writer.loss().has_failed(), "{error}");
        let (missing, state) = recorder.end();
        let (numbers, _) = ring(&memory.files());
        assert!(numbers.iter().copied().eq(0..numbers.len() as u64), "{error}");
        assert!(numbers.len() as u64 <= at);
        assert_eq!(numbers.len() as u64 + missing, 1500, "{error}");
        assert!(state.lacks().is_some() || at == 0, "{error}");
    }
}

/// Frames that the disk was too slow for are counted in the segment in which they are missing, and once in all.
#[test]
fn a_slow_disk_is_counted() {
    let memory = Memory::default();
    let mut recorder = Recorder::begin(&memory, LARGE, &[]);
    recorder.frames(100);
    recorder.dropped.fetch_add(7, Ordering::Relaxed);
    recorder.frames(1000);
    recorder.dropped.fetch_add(3, Ordering::Relaxed);
    recorder.frames(10);
    assert_eq!(recorder.missed.load(Ordering::Relaxed), 2);
    let (missing, state) = recorder.end();
    assert_eq!((missing, state.missing), (10, 10));
    assert!(state.lacks().unwrap().starts_with("10 frames are missing: the disk was too slow"), "{state:?}");
    let (numbers, lacks) = ring(&memory.files());
    assert_eq!((numbers.len(), lacks), (1110, 10));
}

/// A clock that was set back changes no order: numbers go on, and the oldest segment is the one that is deleted.
#[test]
fn a_clock_that_was_set_back_changes_no_order() {
    let memory = Memory::default();
    for run in 0..3 {
        let bounds = Bounds { ring: 150_000, ..SMALL };
        let mut recorder = Recorder::begin(&memory, bounds, &[(1000, Kind::Alarm)]);
        recorder.begin_ns -= run * 86_400_000_000_000;
        recorder.frames(1500);
        assert_eq!(recorder.end().1.lacks(), None);
    }
    let files = memory.files();
    let (numbers, _) = ring(&files);
    assert!(numbers.ends_with(&(0..1500).collect::<Vec<_>>()), "the newest run is whole");
    for number in 1..=3 {
        let (numbers, _) = moment(&files, number).unwrap();
        assert!(numbers.into_iter().eq(700..=1100), "{number}");
    }
    assert_eq!(meta().clock, Clock::Real);
}
