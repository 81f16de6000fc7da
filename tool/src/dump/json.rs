//! Prints a frame as one JSON object on a line. The names of fields contain units; the `text` of a slot is that of
//! the text dump.

use std::io::{self, Write};

use ecmsk::recording::Lacks;
use ecmsk::sk::dump::SlotLine;
use ecmsk::sk::{CrcError, CrcStatus, SlotSize};
use serde::Serialize;
use serde_json::json;

use super::frames::Shown;
use super::slot_json::SlotJson;

#[derive(Serialize)]
struct FrameJson<'a> {
    number: u64,
    /// Nanoseconds since the recording's first frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    time_ns: Option<i64>,
    /// Nanoseconds as recorded: since 1970-01-01, or of a virtual clock.
    #[serde(skip_serializing_if = "Option::is_none")]
    recorded_ns: Option<u64>,
    direction: &'static str,
    direction_guessed: bool,
    slot_bytes: usize,
    crc: CrcJson,
    slots: &'a [SlotJson],
}

/// The CRC: byte 3, and the value for the bytes of the frame.
#[derive(Serialize)]
struct CrcJson {
    status: &'static str,
    found: u8,
    expected: u8,
}

impl From<CrcStatus> for CrcJson {
    fn from(status: CrcStatus) -> Self {
        match status {
            CrcStatus::Right(crc) => Self { status: "right", found: crc, expected: crc },
            CrcStatus::Absent { expected } => Self { status: "absent", found: 0, expected },
            CrcStatus::Wrong(CrcError { expected, found }) => Self { status: "wrong", found, expected },
        }
    }
}

/// Writes a frame as one JSON object.
pub fn write(out: &mut dyn Write, shown: &Shown, lines: &[(usize, SlotLine)]) -> io::Result<()> {
    let slots: Vec<_> = lines.iter().map(|(i, line)| SlotJson::of(*i, line)).collect();
    let frame = FrameJson {
        number: shown.number,
        time_ns: shown.time.map(|time| time.since_start_ns),
        recorded_ns: shown.time.map(|time| time.recorded_ns),
        direction: shown.direction_name(),
        direction_guessed: shown.guessed,
        slot_bytes: SlotSize::bytes(shown.size),
        crc: shown.crc().into(),
        slots: &slots,
    };
    serde_json::to_writer(&mut *out, &frame)?;
    writeln!(out)
}

/// Writes what a recording lacks, after its last frame; for a complete recording nothing.
pub fn write_lacks(out: &mut dyn Write, lacks: &Lacks) -> io::Result<()> {
    let object = json!({ "recording": {
        "whole": false,
        "openings_not_ended": lacks.not_ended,
        "frames_missing": lacks.missing,
        "why": lacks.why,
        "message": lacks.to_string(),
    }});
    writeln!(out, "{object}")
}
