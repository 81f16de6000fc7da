//! The blocks at the beginning and at the end of a recording. Their bytes are lines of text, a word and its value each.
//! Lines with other words are skipped, so that later versions can add some.

use crate::recording::meta::{APPLICATION, RecordMeta};

const META: &str = "meta";
const APPLICATION_LINE: &str = "application";
const PACKETS: &str = "packets";
const MISSING: &str = "missing";
const WHY: &str = "why";
const LENGTH: &str = "length";

/// What was recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Section {
    /// `None` for what another program has captured.
    pub meta: Option<RecordMeta>,
}

impl Section {
    /// The bytes of the block.
    pub fn to_text(&self) -> String {
        let application = concat!("ecmsk ", env!("CARGO_PKG_VERSION"));
        let meta = self.meta.as_ref().map(|meta| format!("{META} {}\n", one_line(&meta.to_string())));
        format!("{APPLICATION_LINE} {application}\n{}", meta.unwrap_or_default())
    }

    /// `None` if the text is not that of such a block.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let text = str::from_utf8(bytes).ok()?;
        value(text, APPLICATION_LINE).filter(|name| name.starts_with(APPLICATION))?;
        Some(Self { meta: value(text, META).and_then(RecordMeta::from_comment) })
    }
}

/// How a recording ended.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct End {
    /// The number of packets in the recording.
    pub packets: u64,
    /// The number of packets that are missing, and why.
    pub missing: u64,
    pub why: Option<String>,
    /// The distance from here back to the beginning of the recording, bytes.
    pub length: u64,
}

impl End {
    /// The bytes of the block.
    pub fn to_text(&self) -> String {
        let why = self.why.as_ref().map(|why| format!("{WHY} {}\n", one_line(why)));
        let Self { packets, missing, length, .. } = self;
        format!("{PACKETS} {packets}\n{MISSING} {missing}\n{LENGTH} {length}\n{}", why.unwrap_or_default())
    }

    /// `None` if the text is not that of such a block.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let text = str::from_utf8(bytes).ok()?;
        let number = |word| value(text, word)?.parse().ok();
        let why = value(text, WHY).map(str::to_owned);
        Some(Self { packets: number(PACKETS)?, missing: number(MISSING)?, length: number(LENGTH)?, why })
    }
}

fn value<'a>(text: &'a str, word: &str) -> Option<&'a str> {
    text.lines().find_map(|line| line.strip_prefix(word)?.strip_prefix(' '))
}

fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}
