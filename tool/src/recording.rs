//! Reads the frames of a recording, each with its time, its slot size and the metadata of the recording.
//!
//! Files:
//!
//! - `recording.rs`: the frames in the order of the file
//! - `recording/walk.rs`: the frames sorted by time, with times that are corrected for jumps of the clock

mod walk;

use std::collections::VecDeque;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use ecmsk::engine::Firmware;
use ecmsk::link::Dir;
use ecmsk::link::uri::LinkUri;
use ecmsk::recording::{
    Address, AddressError, CarriedFile, Lacks, RecordError, RecordMeta, Recorded, Recording, Skipped, WindowOf,
    board_in,
};
use ecmsk::recording::{SizeFinder, SizeFrom};
use ecmsk::sk::{FRAME_LEN, Frame, SlotSize};

pub use walk::Walked;

use super::stderr::say;

/// The most frames that are read ahead to find the slot size, if the recording does not state it.
const LOOK_AHEAD: usize = 1000;

/// The name that stands for standard input.
pub const STDIN: &str = "-";

#[cfg(test)]
thread_local! {
    /// The number of frames that this thread has walked through, for tests of how often a recording is read.
    pub static FRAMES_READ: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

/// A frame of a recording, with its number, its time and its slot size.
#[derive(Clone, Debug)]
pub struct Framed {
    /// The number of the frame in the recording, from 1.
    pub number: u64,
    /// Nanoseconds since the board was opened, which is also the zero of warnings and scripts. In a file without the
    /// opening, since the first frame ([`RecordMeta::zero_ns`]). Negative for a report that was made before.
    pub time_ns: i64,
    /// The frame as it was recorded.
    pub recorded: Recorded,
    /// The slot size of the frame.
    pub size: SlotSize,
    /// The metadata of the section of the file that contains the frame: one opening of a board. `None` in a capture.
    pub meta: Option<Arc<RecordMeta>>,
}

impl Framed {
    /// A frame that was not read from a recording, but just exchanged with a board.
    pub fn live(at_ns: i64, dir: Dir, frame: Frame, size: SlotSize) -> Self {
        let recorded = Recorded {
            at_ns: at_ns.max(0).unsigned_abs(),
            dir,
            frame: Box::new(frame),
            bus: 0,
            device: 0,
            damage_before: 0,
        };
        Self { number: 0, time_ns: at_ns, recorded, size, meta: None }
    }

    /// The board of a capture: its bus and device number.
    pub const fn board(&self) -> (u16, u8) {
        (self.recorded.bus, self.recorded.device)
    }
}

/// A frame as it was read from the file, with the metadata of its section, before its slot size is known.
type Raw = (Recorded, Option<Arc<RecordMeta>>);

/// The frames of a recording, in the order of the file.
pub struct Frames<R> {
    recording: Recording<R>,
    name: String,
    sizes: SizeFinder,
    /// Frames that were read ahead to find the slot size.
    ahead: VecDeque<Result<Raw, RecordError>>,
    meta: Option<Arc<RecordMeta>>,
    number: u64,
    noted: bool,
    /// The number of frames in the whole recording, if only a part of it is read.
    part_of: Option<u64>,
}

impl Frames<Box<dyn Read + Send>> {
    /// Opens a file as [`Self::open`] does, for the range of [times](Framed::time_ns) from `from_ns` to `to_ns`. Of a recording in
    /// blocks (`.ecmrec`) only the blocks are read that this range needs, other files are read from the beginning.
    ///
    /// # Errors
    /// [`RecordError`] if the file cannot be read or is not a recording.
    pub fn open_part(
        file: &Path,
        size: Option<SlotSize>,
        device: Option<Address>,
        (from_ns, to_ns): (i64, i64),
    ) -> Result<Self, RecordError> {
        let name = file.display().to_string();
        let part = WindowOf::open(file, from_ns, to_ns);
        match part.map_err(|error| RecordError::Io { name: name.clone(), message: error.to_string() })? {
            Some(part) => {
                let part_of = Some(part.frames());
                Ok(Self { part_of, ..Self::new(Box::new(part) as Box<dyn Read + Send>, &name, size, device)? })
            }
            None => Self::open(file, size, device),
        }
    }

    /// Opens a file; `-` is standard input. `size` is the slot size that the user has given. With `device`, only the frames of
    /// this device in a capture are read.
    ///
    /// # Errors
    /// [`RecordError`] if the file cannot be read or is not a recording.
    pub fn open(file: &Path, size: Option<SlotSize>, device: Option<Address>) -> Result<Self, RecordError> {
        let (source, name) = source(file)?;
        Self::new(source, &name, size, device)
    }

    /// Opens a file as [`Self::open`] does, for the frames of one [board](board()). Standard input is not searched for boards.
    ///
    /// # Errors
    /// The errors of [`Self::open`] and [`board()`].
    pub fn open_board(file: &Path, size: Option<SlotSize>, asked: Option<Address>) -> Result<Self, RecordError> {
        let device = if file == Path::new(STDIN) { asked } else { board(file, asked)? };
        Self::open(file, size, device)
    }
}

/// Whether both names are those of one file, which exists.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    std::fs::canonicalize(a).ok().zip(std::fs::canonicalize(b).ok()).is_some_and(|(a, b)| a == b)
}

/// The machine file that a recording carries; `None` if it carries none, or the file cannot be read.
pub fn carried(file: &Path) -> Option<Arc<CarriedFile>> {
    Recording::open(file).ok()?.meta()?.machine.clone()
}

/// Opens a file, or standard input for `-`. Returns it with its name for messages.
///
/// # Errors
/// [`RecordError::Io`] if the file cannot be opened.
pub fn source(file: &Path) -> Result<(Box<dyn Read + Send>, String), RecordError> {
    if file == Path::new(STDIN) {
        return Ok((Box::new(std::io::stdin()), "standard input".to_owned()));
    }
    let name = file.display().to_string();
    match File::open(file) {
        Ok(source) => Ok((Box::new(source), name)),
        Err(error) => Err(RecordError::Io { name, message: error.to_string() }),
    }
}

impl<R: Read> Frames<R> {
    /// Reads a recording from any source. `name` is its name for messages.
    ///
    /// # Errors
    /// [`RecordError`] if the source does not begin like a recording.
    pub fn new(source: R, name: &str, size: Option<SlotSize>, device: Option<Address>) -> Result<Self, RecordError> {
        let recording = Recording::new(source, name)?;
        let mut frames = Self {
            recording: match device {
                Some(device) => recording.only(device),
                None => recording,
            },
            name: name.to_owned(),
            sizes: SizeFinder::new(size),
            ahead: VecDeque::new(),
            meta: None,
            number: 0,
            noted: size.is_some(),
            part_of: None,
        };
        frames.look_ahead();
        Ok(frames)
    }

    /// The machine file that the recording carries; `None` if it carries none.
    pub fn carried(&self) -> Option<Arc<CarriedFile>> {
        let first = self.ahead.front().and_then(|found| found.as_ref().ok()).and_then(|(_, meta)| meta.as_deref());
        first.or(self.recording.meta())?.machine.clone()
    }

    /// The number of frames in the whole recording, if only a part of it is read.
    pub const fn part_of(&self) -> Option<u64> {
        self.part_of
    }

    /// For a second reading of the same file: the note that the slot size is an assumption is not printed again.
    pub fn quiet(self) -> Self {
        Self { noted: true, ..self }
    }

    /// Reads ahead until the frames or the metadata show the slot size.
    fn look_ahead(&mut self) {
        while self.ahead.len() < LOOK_AHEAD && !self.sizes.is_sure() {
            let Some(found) = self.read() else { return };
            let told = match &found {
                Ok((_, meta)) if size_told(meta.as_deref()).is_some() => true,
                Ok((recorded, _)) => {
                    self.sizes.look(&recorded.frame, FRAME_LEN);
                    false
                }
                Err(_) => true,
            };
            self.ahead.push_back(found);
            if told {
                return;
            }
        }
    }

    fn read(&mut self) -> Option<Result<Raw, RecordError>> {
        let recorded = self.recording.next()?;
        if self.recording.meta() != self.meta.as_deref() {
            self.meta = self.recording.meta().cloned().map(Arc::new);
        }
        Some(recorded.map(|recorded| (recorded, self.meta.clone())))
    }

    /// The slot size: the one that the user has given, otherwise the recorded one, otherwise the one with which the CRCs of the
    /// frames so far are right. If none of these is known, 12 bytes are assumed, with one note.
    fn size(&mut self, meta: Option<&RecordMeta>) -> SlotSize {
        match (self.sizes.given(), size_told(meta)) {
            (Some(size), _) | (None, Some(size)) => size,
            (None, None) => {
                let (size, from) = self.sizes.size();
                if from == SizeFrom::Assumed && !std::mem::replace(&mut self.noted, true) {
                    note_assumed(&self.name, size);
                }
                size
            }
        }
    }

    /// Prints notes on what is wrong with the recording that [`Frames::walk`] has read to its end.
    pub fn note_walked(&self, walked: &Walked) {
        if let Some(damage) = &walked.damage {
            say("note", damage);
        }
        self.note_jumps(walked);
        self.note_missing();
    }

    /// Prints a note if the clock of the recording has jumped.
    pub fn note_jumps(&self, walked: &Walked) {
        if let Some(jumps) = walked.jumps {
            say("note", &format_args!("{}: {jumps}", self.name));
        }
    }

    /// Prints notes on what the recording lacks and on ignored traffic of a capture. To be called after the last frame.
    pub fn note_missing(&self) {
        note_left_out(&self.name, &self.recording.skipped());
        if let Some(lacks) = self.lacks() {
            say("note", &format_args!("{}: {lacks}", self.name));
        }
    }

    /// Prints a note if the recording does not contain the opening of its board, as one of an older version. Its times
    /// then differ from those of the warnings and scripts of that run. To be called after the first frame was read.
    pub fn note_zero(&self) {
        if self.meta.as_ref().is_some_and(|meta| meta.opened_ns.is_none()) {
            say(
                "note",
                &format_args!(
                    "{}: times count from its first frame: an older version recorded it, without the opening of the board, from \
                     which warnings and scripts count; record the run again to compare times",
                    self.name
                ),
            );
        }
    }

    /// What is known to be missing or damaged in the recording, such as lost frames or its end; `None` if nothing is. To be
    /// called after the last frame.
    pub fn lacks(&self) -> Option<Lacks> {
        Some(self.recording.lacks()).filter(|lacks| !lacks.is_nothing())
    }

    /// What the recording lacks, and why it ends early if it does, as one text; `None` if it is whole.
    pub fn lacks_with(&self, walked: &Walked) -> Option<String> {
        let damage = walked.damage.as_ref().map(ToString::to_string);
        let lacks: Vec<String> = self.lacks().map(|lacks| lacks.to_string()).into_iter().chain(damage).collect();
        (!lacks.is_empty()).then(|| lacks.join("; "))
    }
}

impl<R: Read> Iterator for Frames<R> {
    type Item = Result<Framed, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        let next = match self.ahead.pop_front() {
            Some(next) => next,
            None => self.read()?,
        };
        Some(next.map(|(recorded, meta)| {
            let size = self.size(meta.as_deref());
            let zero_ns = self.recording.zero_ns().unwrap_or(recorded.at_ns);
            self.number += 1;
            Framed { number: self.number, time_ns: since(zero_ns, recorded.at_ns), recorded, size, meta }
        }))
    }
}

/// The firmware of a modelled board, from the link in the recording; `None` if the link does not give it.
pub fn firmware(meta: Option<&RecordMeta>) -> Option<Firmware> {
    let link = LinkUri::parse(&meta?.link).ok()?;
    match link.value("fw")? {
        "1.5" => Some(Firmware::V15),
        _ => Some(Firmware::V17),
    }
}

/// The link of a recording as text for users: without `record=`, and not percent-encoded.
pub fn link_name(meta: &RecordMeta) -> String {
    let Ok(link) = LinkUri::parse(&meta.link) else { return meta.link.clone() };
    let keys = link.keys().filter(|(key, _)| *key != "record").map(|(key, value)| format!("{key}={value}"));
    let keys = keys.collect::<Vec<_>>().join("&");
    format!("{}:{}{}{keys}", link.scheme(), link.path(), if keys.is_empty() { "" } else { "?" })
}

/// Prints a note that the slot size is an assumption. `whose` names the recording, or the line of a list of frames, at the
/// beginning of the note.
pub fn note_assumed(whose: &str, size: SlotSize) {
    let size = size.bytes();
    say(
        "note",
        &format_args!("{whose}: no CRC tells the slot size, taken as {size} bytes; if it is not, give --slot-size"),
    );
}

/// Prints a note on ignored traffic of a capture: frames that the board did not take, and transfers that do not have the
/// length of a frame. Nothing is printed if there are none. `whose` is the name of the capture.
pub fn note_left_out(whose: &str, skipped: &Skipped) {
    if let Some(words) = skipped.words() {
        say("note", &format_args!("{whose}: left out: {words}; look at them in Wireshark"));
    }
}

/// The address of the board in a capture: the requested one, otherwise the only one. `None` if the file is no capture but a
/// recording of this project, which has no addresses.
///
/// # Errors
/// [`RecordError`] if there is no board or more than one.
pub fn board(file: &Path, asked: Option<Address>) -> Result<Option<Address>, RecordError> {
    match asked {
        Some(asked) => Ok(Some(asked)),
        None => board_in(file),
    }
}

/// Parses the USB bus and the device address, such as `1.5`.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn parse_device(text: &str) -> Result<Address, String> {
    text.parse().map_err(|error: AddressError| error.to_string())
}

fn size_told(meta: Option<&RecordMeta>) -> Option<SlotSize> {
    meta?.slot
}

/// `at - zero`, limited to the range of the type, because a damaged file may contain any times.
fn since(zero: u64, at: u64) -> i64 {
    i64::try_from(i128::from(at) - i128::from(zero)).unwrap_or(if at < zero { i64::MIN } else { i64::MAX })
}
