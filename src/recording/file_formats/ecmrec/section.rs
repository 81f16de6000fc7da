//! The contents of the blocks that begin and end a recording. They are lines of text, each with a name, a space and a
//! value. Lines with other names are skipped, so that later versions can add some.

use std::sync::Arc;

use crate::recording::meta::{APPLICATION, CarriedFile, RecordMeta};

const META: &str = "meta";
/// The name of the carried machine file, and each of its lines.
const MACHINE: &str = "machine";
const MACHINE_LINE: &str = "machine-line";
const APPLICATION_LINE: &str = "application";
const PACKETS: &str = "packets";
const MISSING: &str = "missing";
const WHY: &str = "why";
const LENGTH: &str = "length";
const REPEATED: &str = "repeated";

/// The contents of the block that begins a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Section {
    /// The metadata of the recording; `None` if the packets come from another program's capture.
    pub meta: Option<RecordMeta>,
    /// The number of packets at the beginning of the recording that repeat earlier packets, without which the rest
    /// cannot be understood: the settings of a board, in a segment of a flight recorder.
    pub repeated: u32,
}

impl Section {
    /// Encodes the contents of the block.
    pub fn to_text(&self) -> String {
        let application = concat!("ecmsk ", env!("CARGO_PKG_VERSION"));
        let meta = self.meta.as_ref().map(|meta| format!("{META} {}\n", one_line(&meta.to_string())));
        let repeated = (self.repeated > 0).then(|| format!("{REPEATED} {}\n", self.repeated));
        let machine = self.meta.as_ref().and_then(|meta| meta.machine.as_deref()).map(CarriedFile::lines);
        let machine: String = machine
            .into_iter()
            .flat_map(|(name, lines)| {
                let lines = lines.map(|line| format!("{MACHINE_LINE} {line}\n"));
                [format!("{MACHINE} {name}\n")].into_iter().chain(lines)
            })
            .collect();
        let (meta, repeated) = (meta.unwrap_or_default(), repeated.unwrap_or_default());
        format!("{APPLICATION_LINE} {application}\n{meta}{repeated}{machine}")
    }

    /// Decodes the contents of the block; `None` if they are not those of a block that begins a recording.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let text = str::from_utf8(bytes).ok()?;
        value(text, APPLICATION_LINE).filter(|name| name.starts_with(APPLICATION))?;
        let repeated = value(text, REPEATED).and_then(|number| number.parse().ok()).unwrap_or(0);
        let lines = || text.lines().filter_map(|line| line.strip_prefix(MACHINE_LINE)?.strip_prefix(' '));
        let machine = || value(text, MACHINE).map(|name| Arc::new(CarriedFile::from_lines(name, lines())));
        let meta = value(text, META).and_then(RecordMeta::from_comment);
        Some(Self { meta: meta.map(|meta| RecordMeta { machine: machine(), ..meta }), repeated })
    }
}

/// The contents of the block that ends a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct End {
    /// The number of packets in the recording.
    pub packets: u64,
    /// The number of packets that are missing: the recorder did not write them, or the recording that was copied lacked them.
    pub missing: u64,
    /// Why packets are missing; `None` if none is.
    pub why: Option<String>,
    /// The distance from the beginning of this block back to the beginning of the recording, bytes.
    pub length: u64,
}

impl End {
    /// Encodes the contents of the block.
    pub fn to_text(&self) -> String {
        let why = self.why.as_ref().map(|why| format!("{WHY} {}\n", one_line(why)));
        let Self { packets, missing, length, .. } = self;
        format!("{PACKETS} {packets}\n{MISSING} {missing}\n{LENGTH} {length}\n{}", why.unwrap_or_default())
    }

    /// Decodes the contents of the block; `None` if they are not those of a block that ends a recording.
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
