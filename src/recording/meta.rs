//! What a recording says of itself: a comment in the header of its section.

use std::fmt;

use crate::sk::SlotSize;

/// How the application's name begins in the section header of our recordings.
pub(crate) const APPLICATION: &str = "ecmsk ";

/// First word of the comment.
const MARK: &str = "ecmsk";
/// Last field of the comment: all the rest is the link.
const LINK: &str = "link=";
/// Longest link that is written out; the field that holds the comment ends at 65535 bytes.
const LINK_MAX: usize = 60_000;

/// Whose times a simulated board, and a recording of it, has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Clock {
    /// The machine's.
    #[default]
    Real,
    /// The board's own, which pass by calls only.
    Virtual,
}

/// What a recording says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordMeta {
    /// Slot size, if the link knows it.
    pub slot: Option<SlotSize>,
    /// Whether times are those of a clock on the wall.
    pub clock: Clock,
    /// Nanoseconds that were added to the link's time to make the times in the file. On the real clock these are
    /// nanoseconds since 1970-01-01; on a virtual clock nothing is added, unless a process records to the same file again
    /// and the clock began anew: then, on either clock, the times go on where those before have ended.
    pub base_ns: u64,
    /// The link's time when the board was opened, from which warnings and scripts count; `None`: the recording does not tell.
    pub opened_ns: Option<u64>,
    /// The link's URI in normal form.
    pub link: String,
}

impl RecordMeta {
    /// Whether times are the board's own.
    pub(crate) fn is_virtual(&self) -> bool {
        self.clock == Clock::Virtual
    }

    /// When the board was opened, in times of the file; `None`: the recording does not tell.
    pub fn opened_at_ns(&self) -> Option<u64> {
        self.opened_ns.map(|opened_ns| self.base_ns.saturating_add(opened_ns))
    }

    /// Reads the comment back; `None` if it is somebody else's. Fields that are not known are passed over.
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

/// The comment: `ecmsk slot=12 clock=virtual base_ns=0 opened_ns=0 link=sim:?slaves=drive*3`.
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
