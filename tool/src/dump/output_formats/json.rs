//! JSON output: one object per line for each frame or packet. The names of fields contain the units. The field `text`
//! has the lines of the text output.

use std::io::{self, Write};

use ecmsk::link::Dir;
use ecmsk::recording::Lacks;
use ecmsk::recording::exchanges::RecordedBytes;
use ecmsk::sk::dump::SlotLine;
use ecmsk::sk::{CrcError, CrcStatus, SlotSize};
use ecmsk::xf::Status;
use serde::Serialize;
use serde_json::{Value, json};

use super::Format;
use crate::dump::frames::Shown;
use crate::dump::packet::{self, Decoded, Packet};
use crate::dump::pieces::Pieces;
use crate::dump::slot_json::SlotJson;

/// The output format of `--json`.
pub struct Json;

impl Format for Json {
    fn heading(&self, _: &mut dyn Write, _: &str) -> io::Result<()> {
        Ok(())
    }

    fn frame(&self, out: &mut dyn Write, shown: &Shown, slots: &[(usize, SlotLine)]) -> io::Result<()> {
        let slots: Vec<_> = slots.iter().map(|(i, line)| SlotJson::of(*i, line)).collect();
        let place = &shown.place;
        let frame = FrameJson {
            number: place.number,
            time_ns: place.time.map(|time| time.since_start_ns),
            recorded_ns: place.time.map(|time| time.recorded_ns),
            direction: shown.direction_name(),
            direction_guessed: place.guessed,
            slot_bytes: SlotSize::bytes(shown.size),
            crc: shown.crc().into(),
            slots: &slots,
        };
        serde_json::to_writer(&mut *out, &frame)?;
        writeln!(out)
    }

    fn packet(&self, out: &mut dyn Write, packet: &Packet) -> io::Result<()> {
        let place = &packet.place;
        let mut object = of_packet(place.direction, packet.bytes);
        object["number"] = place.number.into();
        match place.time {
            Some(time) => {
                object["time_ns"] = time.since_start_ns.into();
                object["recorded_ns"] = time.recorded_ns.into();
            }
            None => object["direction_guessed"] = place.guessed.into(),
        }
        writeln!(out, "{object}")
    }

    fn pieces(&self, out: &mut dyn Write, pieces: &Pieces, direction: Dir) -> io::Result<()> {
        let (packets, in_none) = pieces.packets(direction);
        let of = |(times, packet): &(u64, RecordedBytes)| {
            let mut object = of_packet(packet.dir, &packet.bytes);
            object["times"] = (*times).into();
            object
        };
        let object = json!({
            "number": pieces.numbers[0],
            "last_number": pieces.numbers[1],
            "time_ns": pieces.since_ns[0],
            "last_time_ns": pieces.since_ns[1],
            "recorded_ns": pieces.recorded_ns,
            "direction": packet::direction_name(direction),
            "pieces": pieces.count,
            "bytes_in_no_packet": in_none,
            "bytes": hex(&pieces.bytes),
            "text": [pieces.summary(&packets, in_none)],
            "packets": packets.iter().map(of).collect::<Vec<Value>>(),
        });
        writeln!(out, "{object}")
    }

    fn lacks(&self, out: &mut dyn Write, lacks: &Lacks) -> io::Result<()> {
        let object = json!({ "recording": {
            "whole": false,
            "openings_not_ended": lacks.not_ended,
            "frames_missing": lacks.missing,
            "why": lacks.why,
            "message": lacks.to_string(),
        }});
        writeln!(out, "{object}")
    }
}

#[derive(Serialize)]
struct FrameJson<'a> {
    number: u64,
    /// Time of the recording in nanoseconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    time_ns: Option<i64>,
    /// The recorded time in nanoseconds: since 1970-01-01, or of a virtual clock.
    #[serde(skip_serializing_if = "Option::is_none")]
    recorded_ns: Option<u64>,
    direction: &'static str,
    direction_guessed: bool,
    slot_bytes: usize,
    crc: CrcJson,
    slots: &'a [SlotJson],
}

/// The CRC of a frame: `found` is its byte 3, `expected` is computed from its other bytes.
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

/// The JSON object for the bytes of a packet in one direction: the bytes themselves, the text, and the decoded fields.
fn of_packet(direction: Dir, bytes: &[u8]) -> Value {
    let decoded = Decoded::of(direction, bytes);
    let mut object = json!({
        "direction": packet::direction_name(direction),
        "bytes": hex(bytes),
        "text": decoded.lines(),
    });
    match &decoded {
        Decoded::Command { packet, .. } => {
            object["index"] = packet.header.index.into();
            object["code"] = packet.header.code.code().into();
        }
        Decoded::Answer { header, .. } => {
            object["index"] = header.index.into();
            object["code"] = header.code.code().into();
            object["nop"] = header.status.contains(Status::NOP).into();
            object["ret"] = header.ret.into();
            object["state"] = header.state.0.into();
            object["errors"] = header.errors.0.into();
            object["rx_fifo"] = header.rx_fifo.into();
            object["tx_fifo"] = header.tx_fifo.into();
        }
        Decoded::NotReady => object["not_ready"] = true.into(),
        Decoded::Damaged(problem) => object["damaged"] = problem.to_string().into(),
        Decoded::NoPacket(_) => {}
    }
    object
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
