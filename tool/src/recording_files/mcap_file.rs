//! A table as MCAP, for Foxglove and PlotJuggler: a channel for the board and one for each slave. Messages are JSON with a
//! JSON schema, which both programs read.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs::File;
use std::io::{self, BufWriter};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};
use serde_json::{Map, Value, json};

use super::table::{Column, Format, Group, Head, Part, Row, Type};

/// The least and the most bytes of a chunk before it is compressed. \[OURS] A reader decompresses whole chunks.
const CHUNK_MIN: u64 = 1 << 20;
const CHUNK_MAX: u64 = 64 << 20;
/// \[OURS] Chunks grow with the file: each has at least this part of the bytes before it. The index of all chunks, of which
/// each takes a kilobyte with 40 axes, is in memory until the file ends.
const CHUNK_PART: u64 = 1024;
/// The bytes that a message takes in a chunk besides its text.
const MESSAGE_HEAD: u64 = 31;

/// The name of the record with what is known of the recording.
const ABOUT: &str = "ecmsk";

/// See the comment of this file.
pub struct McapFile {
    /// `None` once the file is complete.
    writer: Option<Writer<BufWriter<File>>>,
    channels: Vec<Channel>,
    text: String,
    /// The bytes of all messages, and those of the chunk that is being written.
    bytes: u64,
    chunk: u64,
    rows: u32,
}

struct Channel {
    id: u16,
    columns: &'static [Column],
}

impl McapFile {
    /// Begins without a row.
    pub fn new(file: File) -> io::Result<Self> {
        let options = WriteOptions::new()
            .library(format!("ecmsk {}", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            // Threads would take memory for each.
            .compression_threads(0)
            .chunk_size(None);
        let writer = options.create(BufWriter::new(file)).map_err(io_error)?;
        Ok(Self { writer: Some(writer), channels: Vec::new(), text: String::new(), bytes: 0, chunk: 0, rows: 0 })
    }

    fn writer(&mut self) -> io::Result<&mut Writer<BufWriter<File>>> {
        self.writer.as_mut().ok_or_else(|| io::Error::other("the file is complete"))
    }

    fn about(&mut self, metadata: BTreeMap<String, String>) -> io::Result<()> {
        self.writer()?.write_metadata(&Metadata { name: ABOUT.to_owned(), metadata }).map_err(io_error)
    }
}

impl Format for McapFile {
    fn begin(&mut self, head: &Head) -> io::Result<()> {
        let clock = if head.is_virtual { "virtual" } else { "real" };
        let link = head.link.clone().map(|link| ("link".to_owned(), link));
        self.about(link.into_iter().chain([("clock".to_owned(), clock.to_owned())]).collect())?;
        for Group { slave, part } in head.groups {
            let (name, topic) = match part {
                Part::Board => ("board", "/board".to_owned()),
                Part::Axis => ("axis", format!("/axis/{slave}")),
                Part::Pulse => ("pulse axis", format!("/axis/{slave}")),
                Part::Bits => ("io", format!("/io/{slave}")),
            };
            let columns = part.columns();
            let schema = schema(name, columns).to_string();
            let schema = self.writer()?.add_schema(name, "jsonschema", schema.as_bytes()).map_err(io_error)?;
            let id = self.writer()?.add_channel(schema, &topic, "json", &BTreeMap::new()).map_err(io_error)?;
            self.channels.push(Channel { id, columns });
        }
        Ok(())
    }

    fn row(&mut self, row: &Row) -> io::Result<()> {
        if self.chunk > (self.bytes / CHUNK_PART).clamp(CHUNK_MIN, CHUNK_MAX) {
            self.writer()?.flush().map_err(io_error)?;
            self.chunk = 0;
        }
        self.rows = self.rows.wrapping_add(1);
        let mut values = row.values.iter();
        let Some(writer) = &mut self.writer else { return Ok(()) };
        for Channel { id, columns } in &self.channels {
            put(&mut self.text, columns, &mut values);
            let header =
                MessageHeader { channel_id: *id, sequence: self.rows, log_time: row.at_ns, publish_time: row.at_ns };
            writer.write_to_known_channel(&header, self.text.as_bytes()).map_err(io_error)?;
            let bytes = MESSAGE_HEAD + self.text.len() as u64;
            (self.bytes, self.chunk) = (self.bytes + bytes, self.chunk + bytes);
        }
        Ok(())
    }

    fn finish(&mut self, lacks: Option<String>) -> io::Result<()> {
        if let Some(lacks) = lacks {
            self.about([("lacks".to_owned(), lacks)].into())?;
        }
        let Some(mut writer) = self.writer.take() else { return Ok(()) };
        writer.finish().map_err(io_error)?;
        io::Write::flush(&mut writer.into_inner())
    }
}

/// Makes the message of a channel: a JSON object with the values that are known.
fn put<'a>(text: &mut String, columns: &[Column], values: &mut impl Iterator<Item = &'a Option<i64>>) {
    text.clear();
    text.push('{');
    for (column, value) in columns.iter().zip(values) {
        let Some(value) = value else { continue };
        let comma = if text.len() > 1 { "," } else { "" };
        let name = column.name;
        // Writing to a String does not fail.
        let _ = match column.ty {
            Type::Percent => write!(text, "{comma}\"{name}\":{}", *value as f64 / 10.0),
            Type::I32 | Type::U16 => write!(text, "{comma}\"{name}\":{value}"),
        };
    }
    text.push('}');
}

/// The JSON schema of the messages of a channel. A value that is not known is left out of its message: viewers do not know
/// of numbers that may be null.
fn schema(title: &str, columns: &[Column]) -> Value {
    let property = |column: &Column| {
        let ty = if column.ty == Type::Percent { "number" } else { "integer" };
        (column.name.to_owned(), json!({"type": ty, "description": column.about}))
    };
    let properties: Map<String, Value> = columns.iter().map(property).collect();
    json!({"title": title, "type": "object", "properties": properties})
}

fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        error => io::Error::other(error),
    }
}
