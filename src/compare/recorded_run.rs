//! A recording as a run that can be compared.

use std::fs::File;
use std::path::Path;

use super::{Side, TimedFrame};
use crate::link::Dir;
use crate::recording::{Address, RecordError, RecordMeta, Recorded, Recording, Skipped, board_in};
use crate::recording::{InOrder, Jumps, SizeFinder, SizeFrom, Timeline};
use crate::sk::{FRAME_LEN, SlotSize};

/// The maximum number of frames that are read to find the slot size of a recording that does not state it. \[OURS]
const SLOT_SIZE_FRAMES_MAX: usize = 1000;

/// Why runs cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompareError {
    /// A recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// The two runs have slots of different sizes.
    #[error(
        "A has slots of {} bytes and B of {}: their frames cannot be compared; if one of them is wrong, give the slot \
         size",
        .a.bytes(),
        .b.bytes()
    )]
    SlotSizes {
        /// The slot size of the first run.
        a: SlotSize,
        /// The slot size of the second run.
        b: SlotSize,
    },
    /// The recordings match as far as both go, and one of them is incomplete.
    #[error("equal as far as they go, but {side} is not whole: {why}")]
    Incomplete {
        /// The incomplete recording.
        side: Side,
        /// What is missing in the recording, and what the user can do about it.
        why: String,
    },
    /// A recording holds no frame.
    #[error("{name} holds no frame; record a program that opens the board")]
    Empty {
        /// The name of the recording's file.
        name: String,
    },
}

/// The frames of a recording, sorted by time, as an iterator. If the recording is a USB capture, only the frames of one
/// board. The iterator ends where the file is damaged, and [`RecordedRun::damage`] then returns the reason; the frames
/// before it are intact.
pub struct RecordedRun {
    recording: Recording<File>,
    /// The time of the first frame in the recording, which is the zero of [`TimedFrame::at_ns`].
    first_ns: u64,
    board: Address,
    meta: Option<RecordMeta>,
    size: SlotSize,
    size_from: SizeFrom,
    timeline: Timeline<(u64, Recorded)>,
    /// Boxed, because a late frame moves those around its place.
    order: InOrder<Box<TimedFrame>>,
    number: u64,
    error: Option<RecordError>,
}

impl RecordedRun {
    /// Opens a recording.
    ///
    /// `slot` is its slot size, `None` for the one that the recording states or that its frames show. `device` is the USB
    /// address of the board in a capture, `None` to search for it.
    ///
    /// # Errors
    /// [`CompareError::Recording`]: the file cannot be read, or the board in it cannot be found. [`CompareError::Empty`]:
    /// it holds no frame.
    pub fn open(path: &Path, slot: Option<SlotSize>, device: Option<Address>) -> Result<Self, CompareError> {
        let device = match device {
            Some(device) => Some(device),
            None => board_in(path)?,
        };
        let mut beginning = open(path, device)?;
        let first = beginning.next().transpose()?;
        let first = first.ok_or_else(|| CompareError::Empty { name: path.display().to_string() })?;
        let meta = beginning.meta().cloned();
        let mut sizes = SizeFinder::new(slot.or_else(|| meta.as_ref()?.slot));
        sizes.look(&first.frame, FRAME_LEN);
        for recorded in beginning.map_while(Result::ok).take(SLOT_SIZE_FRAMES_MAX) {
            if sizes.is_sure() {
                break;
            }
            sizes.look(&recorded.frame, FRAME_LEN);
        }
        let (size, size_from) = sizes.size();
        Ok(Self {
            recording: open(path, device)?,
            first_ns: first.at_ns,
            board: first.address(),
            meta,
            size,
            size_from,
            timeline: Timeline::default(),
            order: InOrder::default(),
            number: 0,
            error: None,
        })
    }

    /// The USB address of the board whose frames these are.
    pub const fn board(&self) -> Address {
        self.board
    }

    /// What the recording states before its first frame: the link, the slot size and the clock. `None` for a capture that
    /// another program made.
    pub const fn meta(&self) -> Option<&RecordMeta> {
        self.meta.as_ref()
    }

    /// The time of the first frame in nanoseconds, on the recording's own clock. [`TimedFrame::at_ns`] counts from it.
    pub const fn first_ns(&self) -> u64 {
        self.first_ns
    }

    /// The packets in the part read so far that are not frames of a board.
    pub fn skipped(&self) -> Skipped {
        self.recording.skipped()
    }

    /// The slot size of the frames.
    pub const fn size(&self) -> SlotSize {
        self.size
    }

    /// Whether the slot size is an assumption, because the caller, the recording and its frames do not show it.
    pub fn is_size_assumed(&self) -> bool {
        self.size_from == SizeFrom::Assumed
    }

    /// The number of frames that the recorder could not write, as the recording states it in the part read so far.
    pub const fn missing(&self) -> u64 {
        self.recording.missing()
    }

    /// Why the recording is not the whole run: it is cut off or damaged, was not ended, or lacks frames. `None` if it
    /// seems whole. The result is final only after the last frame was read.
    pub fn shortcoming(&self) -> Option<String> {
        let lacks = || Some(self.recording.lacks()).filter(|lacks| !lacks.is_nothing());
        self.error.as_ref().map(RecordError::to_string).or_else(|| lacks().map(|lacks| lacks.to_string()))
    }

    /// How often, where and how far the clock of the recording was set forward or back, in the part read so far; `None` if
    /// it was not.
    pub const fn jumps(&self) -> Option<Jumps> {
        self.timeline.jumps()
    }

    /// Sorts the frames by time, because a report that the host read late follows later commands in the file. Takes the
    /// next frame of the file. Once enough frames are buffered that no earlier one can follow, returns the earliest of
    /// them.
    fn sort(&mut self, (at_ns, (number, recorded)): (i64, (u64, Recorded))) -> Option<TimedFrame> {
        let Recorded { dir, frame, .. } = recorded;
        // At equal times a report is sorted before a command, since the board cannot have executed that command yet. So
        // the key is twice the time, plus 1 for a command.
        let key = at_ns.saturating_mul(2).saturating_add(i64::from(dir == Dir::Write));
        self.order.push(key, Box::new(TimedFrame { number, at_ns, dir, frame: *frame })).map(|frame| *frame)
    }

    /// Why the frames ended early: the file is cut off, damaged or cannot be read. `None` if they did not.
    pub const fn damage(&self) -> Option<&RecordError> {
        self.error.as_ref()
    }

    /// Checks that the file was read up to its end, or up to where it is cut off or damaged: the frames before the damage
    /// can be compared.
    ///
    /// # Errors
    /// [`CompareError::Recording`] if reading failed for another reason.
    pub fn check(&self) -> Result<(), CompareError> {
        match &self.error {
            None | Some(RecordError::Truncated { .. } | RecordError::Malformed { .. }) => Ok(()),
            Some(error) => Err(error.clone().into()),
        }
    }

    /// The slot size of both runs.
    ///
    /// # Errors
    /// [`CompareError::SlotSizes`] if they have different ones.
    pub fn common_size(a: &Self, b: &Self) -> Result<SlotSize, CompareError> {
        match (a.size, b.size) {
            (a, b) if a == b => Ok(a),
            (a, b) => Err(CompareError::SlotSizes { a, b }),
        }
    }
}

impl Iterator for RecordedRun {
    type Item = TimedFrame;

    fn next(&mut self) -> Option<TimedFrame> {
        while self.error.is_none() {
            let recorded = match self.recording.next() {
                Some(Ok(recorded)) => recorded,
                Some(Err(error)) => {
                    self.error = Some(error);
                    break;
                }
                None => break,
            };
            self.number += 1;
            if recorded.address() != self.board {
                continue;
            }
            let placed = self.timeline.push(recorded.at_ns, (self.number, recorded));
            if let Some(earliest) = placed.and_then(|placed| self.sort(placed)) {
                return Some(earliest);
            }
        }
        let last = self.timeline.pop();
        last.and_then(|placed| self.sort(placed)).or_else(|| self.order.pop().map(|frame| *frame))
    }
}

fn open(path: &Path, device: Option<Address>) -> Result<Recording<File>, RecordError> {
    let recording = Recording::open(path)?;
    Ok(match device {
        Some(device) => recording.only(device),
        None => recording,
    })
}
