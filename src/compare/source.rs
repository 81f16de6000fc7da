//! Recordings as runs to compare.

use std::fs::File;
use std::path::Path;

use super::{Observed, Side};
use crate::link::Dir;
use crate::recording::{Address, RecordError, RecordMeta, Recorded, Recording, Skipped, board_in};
use crate::recording::{InOrder, Jumps, SizeFinder, SizeFrom, Timeline};
use crate::sk::{FRAME_LEN, SlotSize};

/// Frames that are looked at, at most, to find a slot size that the recording does not tell. \[OURS]
const LOOK_AT: usize = 1000;

/// Why runs cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompareError {
    /// A recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// Frames of different kinds.
    #[error(
        "A has slots of {} bytes and B of {}: their frames cannot be held against each other; if one of them is wrong, give the slot size",
        .a.bytes(),
        .b.bytes()
    )]
    SlotSizes {
        /// Of the first.
        a: SlotSize,
        /// Of the second.
        b: SlotSize,
    },
    /// There is no difference as far as both go, and one of them is not whole.
    #[error("equal as far as they go, but {side} is not whole: {why}")]
    Incomplete {
        /// Which.
        side: Side,
        /// What it lacks, with the next step.
        why: String,
    },
    /// Nothing to compare.
    #[error("{name} holds no frame; record a program that opens the board")]
    Empty {
        /// The recording.
        name: String,
    },
}

/// The frames of a recording in the order of their times; of a capture those of its board. It ends at damage: what comes
/// before is whole, and [`Source::damage`] tells.
pub struct Source {
    recording: Recording<File>,
    /// Since when times count.
    first_ns: u64,
    board: Address,
    meta: Option<RecordMeta>,
    size: SlotSize,
    size_from: SizeFrom,
    timeline: Timeline<(u64, Recorded)>,
    order: InOrder<Observed>,
    number: u64,
    error: Option<RecordError>,
}

impl Source {
    /// Opens a recording. `slot`: its slot size, if it is known better than the recording tells. `device`: the board of a
    /// capture, if it is not to be looked for.
    ///
    /// # Errors
    /// [`CompareError::Recording`], [`CompareError::Empty`].
    pub fn open(path: &Path, slot: Option<SlotSize>, device: Option<Address>) -> Result<Self, CompareError> {
        let device = match device {
            Some(device) => Some(device),
            None => board_in(path)?,
        };
        let Start { first, meta, size, size_from } = Start::of(path, slot, device)?;
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

    /// Which board's frames these are.
    pub const fn board(&self) -> Address {
        self.board
    }

    /// What the recording says of itself at its first frame; `None` for a capture that somebody else made.
    pub const fn meta(&self) -> Option<&RecordMeta> {
        self.meta.as_ref()
    }

    /// When the first frame passed, as the recording has it: times count from there.
    pub const fn first_ns(&self) -> u64 {
        self.first_ns
    }

    /// What of a capture was left out, as far as it was read.
    pub fn skipped(&self) -> Skipped {
        self.recording.skipped()
    }

    /// Bytes of a slot.
    pub const fn size(&self) -> SlotSize {
        self.size
    }

    /// Whether the slot size is but assumed.
    pub fn is_size_assumed(&self) -> bool {
        self.size_from == SizeFrom::Assumed
    }

    /// Frames that are known to be missing, as far as it was read.
    pub const fn missing(&self) -> u64 {
        self.recording.missing()
    }

    /// What it lacks, once it was read: it is cut off or damaged, was not ended, or frames are known to be missing. `None`
    /// if nothing tells that it is not the whole run.
    pub fn shortcoming(&self) -> Option<String> {
        let lacks = || Some(self.recording.lacks()).filter(|lacks| !lacks.is_nothing());
        self.error.as_ref().map(RecordError::to_string).or_else(|| lacks().map(|lacks| lacks.to_string()))
    }

    /// Where its times jump, as far as it was read.
    pub const fn jumps(&self) -> Option<Jumps> {
        self.timeline.jumps()
    }

    /// Takes a frame in the order of the file, with its time; gives the earliest, once enough are held.
    fn sort(&mut self, (at_ns, (number, recorded)): (i64, (u64, Recorded))) -> Option<Observed> {
        let Recorded { dir, frame, .. } = recorded;
        // A command of the same moment had not reached the board when the report was made.
        let key = at_ns.saturating_mul(2).saturating_add(i64::from(dir == Dir::Write));
        self.order.push(key, Observed { number, at_ns, dir, frame })
    }

    /// Why it ended early, if it did: it was cut off or is damaged.
    pub const fn damage(&self) -> Option<&RecordError> {
        self.error.as_ref()
    }

    /// That it could be read, to its end or to where it is cut off.
    ///
    /// # Errors
    /// [`CompareError::Recording`].
    pub fn check(&self) -> Result<(), CompareError> {
        match &self.error {
            None | Some(RecordError::Truncated { .. } | RecordError::Malformed { .. }) => Ok(()),
            Some(error) => Err(error.clone().into()),
        }
    }

    /// The slot size of two runs.
    ///
    /// # Errors
    /// [`CompareError::SlotSizes`].
    pub fn common_size(a: &Self, b: &Self) -> Result<SlotSize, CompareError> {
        match (a.size, b.size) {
            (a, b) if a == b => Ok(a),
            (a, b) => Err(CompareError::SlotSizes { a, b }),
        }
    }
}

impl Iterator for Source {
    type Item = Observed;

    fn next(&mut self) -> Option<Observed> {
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
        last.and_then(|placed| self.sort(placed)).or_else(|| self.order.pop())
    }
}

/// What the first frames tell.
struct Start {
    first: Recorded,
    meta: Option<RecordMeta>,
    size: SlotSize,
    size_from: SizeFrom,
}

fn open(path: &Path, device: Option<Address>) -> Result<Recording<File>, RecordError> {
    let recording = Recording::open(path)?;
    Ok(match device {
        Some(device) => recording.only(device),
        None => recording,
    })
}

impl Start {
    fn of(path: &Path, slot: Option<SlotSize>, device: Option<Address>) -> Result<Self, CompareError> {
        let mut recording = open(path, device)?;
        let first = recording.next().transpose()?;
        let first = first.ok_or_else(|| CompareError::Empty { name: path.display().to_string() })?;
        let meta = recording.meta().cloned();
        let told = slot.or_else(|| meta.as_ref()?.slot);
        let mut sizes = SizeFinder::new(told);
        sizes.look(&first.frame, FRAME_LEN);
        for recorded in recording.map_while(Result::ok).take(LOOK_AT) {
            if sizes.is_sure() {
                break;
            }
            sizes.look(&recorded.frame, FRAME_LEN);
        }
        let (size, size_from) = sizes.size();
        Ok(Self { first, meta, size, size_from })
    }
}
