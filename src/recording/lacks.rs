//! What is missing in a recording.

use std::fmt;

use super::RecordMeta;

/// A stretch of a recording that cannot be read, since its bytes are damaged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lost {
    /// The number of unreadable bytes.
    pub bytes: u64,
    /// The least number of frames in the unreadable bytes: blocks whose headers are damaged as well are not counted.
    pub packets: u64,
    /// The time in the file from which frames are lost, ns: that of the first lost frame if a header shows it,
    /// otherwise that of the last frame before. `None` if neither is known.
    pub from_ns: Option<u64>,
    /// The time in the file up to which frames are lost, ns: that of the last lost frame if a header shows it,
    /// otherwise that of the first frame after. `None` if neither is known.
    pub to_ns: Option<u64>,
    /// Whether a newer version of this crate wrote some of these bytes.
    pub is_newer: bool,
}

/// The stretches of a recording that cannot be read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// The number of stretches that cannot be read, also those that [`Self::first`] does not list.
    pub count: u64,
    /// The sum of all stretches: their bytes and frames, from the earliest to the latest time.
    pub whole: Lost,
    /// The first stretches one by one, at most [`Damage::LISTED`].
    pub first: Vec<Lost>,
    /// The time in the file from which the times in messages count, ns: [`RecordMeta::zero_ns`](super::RecordMeta::zero_ns).
    pub begin_ns: u64,
}

impl Damage {
    /// The most stretches that [`Self::first`] keeps. \[OURS]
    pub const LISTED: usize = 16;
    /// The most stretches that the text of the damage gives one by one. \[OURS]
    const NAMED: usize = 3;

    pub(super) fn add(&mut self, lost: Lost) {
        let whole = &mut self.whole;
        whole.bytes = whole.bytes.saturating_add(lost.bytes);
        whole.packets = whole.packets.saturating_add(lost.packets);
        whole.from_ns = [whole.from_ns, lost.from_ns].into_iter().flatten().min();
        whole.to_ns = whole.to_ns.max(lost.to_ns);
        whole.is_newer |= lost.is_newer;
        self.count += 1;
        if self.first.len() < Self::LISTED {
            self.first.push(lost);
        }
    }

    fn stretch(&self, lost: &Lost) -> String {
        let seconds = |ns: u64| (i128::from(ns) - i128::from(self.begin_ns)) as f64 / 1e9;
        let times = match (lost.from_ns.map(seconds), lost.to_ns.map(seconds)) {
            (Some(from), Some(to)) => format!("from {from:.3} s to {to:.3} s"),
            (Some(from), None) => format!("from {from:.3} s on"),
            (None, Some(to)) => format!("up to {to:.3} s"),
            (None, None) => "at an unknown time".to_owned(),
        };
        let packets = if lost.packets > 0 { format!("{} frames or more, ", lost.packets) } else { String::new() };
        format!("{times} ({packets}{} bytes)", lost.bytes)
    }
}

/// Writes one line for messages, which name the file themselves.
impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = self.first.iter().take(Self::NAMED).map(|lost| self.stretch(lost));
        write!(f, "damaged, and not read: {}", named.collect::<Vec<_>>().join(", "))?;
        if self.count > Self::NAMED as u64 {
            write!(f, ", and {} more stretches, {} bytes in all", self.count - Self::NAMED as u64, self.whole.bytes)?;
        }
        if self.whole.is_newer {
            f.write_str("; a newer version of ecmsk has written some of it: read it with that one")?;
        }
        Ok(())
    }
}

/// What is missing in a recording, as far as it was read. It is complete once the recording was read to its end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lacks {
    /// The number of sections without an end. The recorder writes one section for each opening of a board.
    pub not_ended: u64,
    /// The number of frames that passed the link and are not in the recording.
    pub missing: u64,
    /// Why frames are missing, as the recorder has noted it in the file. `None`: the file gives no reason.
    pub why: Option<String>,
    /// The damaged parts of a recording in blocks (`.ecmrec`), which the reader skips. Reading other formats ends with
    /// an error at the first damage.
    pub damage: Damage,
}

impl Lacks {
    /// Returns the same with [`Damage::begin_ns`] set. `zero_ns`: the time in the file from which times of frames
    /// count; `None` if no frame could be read. In that case the time is taken from the metadata, or else it is the
    /// first known time of the damage.
    pub(super) fn since(mut self, zero_ns: Option<u64>, meta: Option<&RecordMeta>) -> Self {
        if self.damage.count > 0 {
            let first_ns = self.damage.whole.from_ns.or(self.damage.whole.to_ns).unwrap_or_default();
            self.damage.begin_ns = zero_ns.unwrap_or_else(|| RecordMeta::zero_ns(meta, first_ns));
        }
        self
    }

    /// Whether no section lacks its end, no frame is known to be missing, and all bytes could be read.
    pub const fn is_nothing(&self) -> bool {
        self.not_ended == 0 && self.missing == 0 && self.damage.count == 0
    }
}

/// Writes one line for messages, which name the file themselves.
impl fmt::Display for Lacks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.damage.count > 0 {
            write!(f, "{}", self.damage)?;
            if self.missing == 0 && self.not_ended == 0 {
                return Ok(());
            }
            f.write_str("; ")?;
        }
        if self.missing > 0 {
            match &self.why {
                Some(why) => write!(f, "{} frames are missing: {why}", self.missing)?,
                None => write!(f, "{} frames are missing", self.missing)?,
            }
            if self.not_ended > 0 {
                f.write_str("; ")?;
            }
        }
        match self.not_ended {
            0 if self.missing == 0 => f.write_str("nothing is known to be missing"),
            0 => f.write_str("; record again, to a disk that is fast and has room, to have them all"),
            _ => f.write_str(
                "the recording was not ended, what came after its last frame is not in it; its program was killed, still \
                 runs, or could not write: let it end by itself, on a disk with room, to have all",
            ),
        }
    }
}
