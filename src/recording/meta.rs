//! The metadata of a recording: a comment in the header of its section.

use std::fmt;

use crate::sk::SlotSize;

/// The first characters of the application's name in the section header of recordings of this crate.
pub(crate) const APPLICATION: &str = "ecmsk ";

/// The first word of the comment with the metadata.
const MARK: &str = "ecmsk";
/// The name of the last field in the comment. Its value is the rest of the comment: the link.
const LINK: &str = "link=";
/// The most bytes of the link that are written; a longer link is cut. The comment of pcapng, which also has the other
/// fields, may have 65535 bytes.
const LINK_MAX: usize = 60_000;
/// How much later than the first frame a board may have been opened, ns. \[OURS]
const OPENED_AFTER_MAX_NS: u64 = 5_000_000_000;

/// The clock that stamps the frames of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Clock {
    /// The real clock of the machine.
    #[default]
    Real,
    /// The clock of a simulated board that advances only inside calls.
    Virtual,
}

/// The metadata of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordMeta {
    /// The slot size; `None` if the link does not know it.
    pub slot: Option<SlotSize>,
    /// The clock of the times in the file.
    pub clock: Clock,
    /// What has to be added to the link's time to get the time in the file, ns. With the real clock, times in the file
    /// count from 1970-01-01; with a virtual clock this is 0. If a program records to the same file again and its clock
    /// begins at 0 again, the recorder increases this value, so that times in the file never go back; that is so with
    /// either clock.
    pub base_ns: u64,
    /// The link's time at which the board was opened, ns: see [`RecordMeta::zero_ns`]. `None` if the recording does not
    /// have it.
    pub opened_ns: Option<u64>,
    /// The link's URI in normal form: keys in a fixed order, keys with their default values left out.
    pub link: String,
}

impl RecordMeta {
    /// Whether the times are those of a virtual clock.
    pub(crate) fn is_virtual(&self) -> bool {
        self.clock == Clock::Virtual
    }

    /// The time of the file at which the board was opened, ns; `None` if the recording does not have it.
    pub fn opened_at_ns(&self) -> Option<u64> {
        self.opened_ns.map(|opened_ns| self.base_ns.saturating_add(opened_ns))
    }

    /// The time of a file from which the times of its frames count, ns: when the board was opened, from which warnings and
    /// scripts count, too. If the recording does not have that, the time of its first frame, `first_ns`. `meta`: the
    /// metadata of the file's first section; `None` for a capture.
    pub fn zero_ns(meta: Option<&Self>, first_ns: u64) -> u64 {
        let opened_ns = meta.and_then(Self::opened_at_ns);
        // A report that was made some cycles before the opening may be read after it. A board that was opened long after
        // the first frame is a damaged number.
        let latest_ns = first_ns.saturating_add(OPENED_AFTER_MAX_NS);
        opened_ns.filter(|opened_ns| *opened_ns <= latest_ns).unwrap_or(first_ns)
    }

    /// Parses the comment with the metadata; `None` if another program wrote it. Unknown fields are ignored.
    pub(super) fn from_comment(comment: &str) -> Option<Self> {
        let rest = comment.strip_prefix(MARK)?.strip_prefix(' ')?;
        let (fields, link) = rest.split_at_checked(rest.find(LINK)?)?;
        let link = link[LINK.len()..].to_owned();
        let mut meta = Self { slot: None, clock: Clock::Real, base_ns: 0, opened_ns: None, link };
        for field in fields.split(' ') {
            match field.split_once('=') {
                Some(("slot", value)) => meta.slot = value.parse().ok().and_then(SlotSize::from_bytes),
                Some(("clock", "virtual")) => meta.clock = Clock::Virtual,
                Some(("base_ns", value)) => meta.base_ns = value.parse().ok()?,
                Some(("opened_ns", value)) => meta.opened_ns = value.parse().ok(),
                _ => {}
            }
        }
        Some(meta)
    }
}

/// Writes the comment with the metadata, such as `ecmsk slot=12 clock=virtual base_ns=0 opened_ns=0
/// link=sim:?slaves=drive*3`.
impl fmt::Display for RecordMeta {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{MARK}")?;
        if let Some(slot) = self.slot {
            write!(f, " slot={}", slot.bytes())?;
        }
        let clock = match self.clock {
            Clock::Real => "real",
            Clock::Virtual => "virtual",
        };
        let link = &self.link[..self.link.floor_char_boundary(LINK_MAX)];
        write!(f, " clock={clock} base_ns={}", self.base_ns)?;
        if let Some(opened_ns) = self.opened_ns {
            write!(f, " opened_ns={opened_ns}")?;
        }
        write!(f, " {LINK}{link}")
    }
}
