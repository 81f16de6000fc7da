//! The metadata of a recording: a comment in the header of its section.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

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
    /// begins at 0 again, the recorder increases this value. So times in the file never go back, with either clock.
    pub base_ns: u64,
    /// The link's time at which the board was opened, ns: see [`RecordMeta::zero_ns`]. `None` if the recording does not
    /// have it.
    pub opened_ns: Option<u64>,
    /// The link's URI in normal form: keys in a fixed order, keys with their default values left out.
    pub link: String,
    /// The machine file that the recording carries; `None` if it carries none. It is not part of the comment with the
    /// other metadata.
    pub machine: Option<Arc<CarriedFile>>,
}

/// A machine file that a recording carries, so that its axes have their names and units wherever it is read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CarriedFile {
    name: String,
    text: String,
}

/// The beginning of a comment with a part of a carried file. The number of the part, from 1, and the name of the file
/// follow, then a line feed and the part. It does not begin as the comment with the metadata, so that earlier versions
/// pass over it.
const PART: &str = "ecmsk-machine ";
/// The most bytes of a part, because a comment of pcapng may have 65535 bytes. \[OURS]
const PART_MAX: usize = 60_000;
/// The most bytes of the file's name that are kept. \[OURS]
const NAME_MAX: usize = 255;

impl CarriedFile {
    /// The file at `path` with this text. The name is that of the file without its folder. Each line of the text ends
    /// with a line feed.
    pub fn new(path: &Path, text: &str) -> Self {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        let name: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        let name = name[..name.floor_char_boundary(NAME_MAX)].trim().to_owned();
        Self { name, text: text.lines().flat_map(|line| [line, "\n"]).collect() }
    }

    /// The name of the file, without its folder.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The text of the file.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The comments that carry the file.
    pub(crate) fn comments(&self) -> Vec<String> {
        let mut comments = Vec::new();
        let mut rest = &*self.text;
        while !rest.is_empty() {
            let (part, behind) = rest.split_at(rest.floor_char_boundary(PART_MAX));
            comments.push(format!("{PART}{} {}\n{part}", comments.len() + 1, self.name));
            rest = behind;
        }
        comments
    }

    /// Puts the file together from the comments of a section; `None` if none of them carries a part of it.
    pub(super) fn from_comments<'c>(comments: impl Iterator<Item = &'c str>) -> Option<Self> {
        let mut file: Option<Self> = None;
        let mut parts = 0;
        for comment in comments {
            let Some((head, part)) = comment.strip_prefix(PART).and_then(|rest| rest.split_once('\n')) else {
                continue;
            };
            let Some((number, name)) = head.split_once(' ') else { continue };
            if number.parse() != Ok(parts + 1) {
                continue;
            }
            parts += 1;
            file.get_or_insert_with(|| Self { name: name.to_owned(), text: String::new() }).text.push_str(part);
        }
        file
    }

    /// The lines that carry the file in a recording in blocks: its name, and its lines.
    pub(super) fn lines(&self) -> (&str, impl Iterator<Item = &str>) {
        (&self.name, self.text.lines())
    }

    /// Puts the file together from its name and its lines.
    pub(super) fn from_lines<'l>(name: &str, lines: impl Iterator<Item = &'l str>) -> Self {
        Self { name: name.to_owned(), text: lines.flat_map(|line| [line, "\n"]).collect() }
    }
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
        // The first frame may be a report that was made some cycles before the opening and read after it. If the
        // opening is long after the first frame, its time is a damaged number.
        let latest_ns = first_ns.saturating_add(OPENED_AFTER_MAX_NS);
        opened_ns.filter(|opened_ns| *opened_ns <= latest_ns).unwrap_or(first_ns)
    }

    /// Parses the comment with the metadata; `None` if another program wrote it. Unknown fields are ignored.
    pub(super) fn from_comment(comment: &str) -> Option<Self> {
        let rest = comment.strip_prefix(MARK)?.strip_prefix(' ')?;
        let (fields, link) = rest.split_at_checked(rest.find(LINK)?)?;
        let link = link[LINK.len()..].to_owned();
        let mut meta = Self { slot: None, clock: Clock::Real, base_ns: 0, opened_ns: None, link, machine: None };
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A machine file of any length is carried by comments of pcapng, and by lines; other comments are passed over.
    #[test]
    fn a_machine_file_is_carried_whole() {
        for text in ["format = 1\n", "a\r\nb\n\n c = \"\u{FC}\"", &"x = \"\u{FC}\u{FC}\"\n".repeat(20_000)] {
            let file = CarriedFile::new(Path::new("/machines/portal 3.toml"), text);
            assert_eq!(file.name(), "portal 3.toml");
            assert_eq!(file.text().lines().collect::<Vec<_>>(), text.lines().collect::<Vec<_>>());
            let comments = file.comments();
            assert!(comments.iter().all(|comment| comment.len() < 65_535));
            assert!(comments.iter().all(|comment| RecordMeta::from_comment(comment).is_none()));
            let all = ["of another program"].into_iter().chain(comments.iter().map(String::as_str));
            assert_eq!(CarriedFile::from_comments(all).as_ref(), Some(&file));
            let (name, lines) = file.lines();
            assert_eq!(CarriedFile::from_lines(name, lines), file);
        }
        assert_eq!(CarriedFile::from_comments(["ecmsk slot=12 link=sim:", "ecmsk-machine 2 a\nx"].into_iter()), None);
    }
}
