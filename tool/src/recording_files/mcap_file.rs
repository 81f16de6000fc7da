//! Writes a table as MCAP, for Foxglove and PlotJuggler: a channel for the board and one for each slave. The messages
//! are JSON with a JSON schema, which both programs can read.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs::File;
use std::io::{self, BufWriter};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};
use serde_json::{Map, Value, json};

use super::table::{Column, Format, Group, Head, Part, Row, Type};

/// The smallest size of a chunk before compression, in bytes, and (next constant) the largest one. \[OURS] A reader
/// always decompresses whole chunks.
const CHUNK_MIN: u64 = 1 << 20;
const CHUNK_MAX: u64 = 64 << 20;
/// \[OURS] Chunks grow with the file: each has at least this fraction of the bytes before it. This limits the memory
/// for the index of all chunks, which is kept until the file ends. With 40 axes the index needs a kilobyte per chunk.
const CHUNK_PART: u64 = 1024;
/// The number of bytes of a message in a chunk in addition to its text.
const MESSAGE_HEAD: u64 = 31;

/// The name of the metadata record about the recording.
const ABOUT: &str = "ecmsk";

/// A table in an MCAP file.
pub struct McapFile {
    /// `None` once the file is complete.
    writer: Option<Writer<BufWriter<File>>>,
    channels: Vec<Channel>,
    text: String,
    /// The number of bytes of all messages, and (next field) of the messages in the present chunk.
    bytes: u64,
    chunk: u64,
    rows: u32,
}

struct Channel {
    id: u16,
    columns: &'static [Column],
}

impl McapFile {
    /// Creates a table without rows.
    pub fn new(file: File) -> io::Result<Self> {
        let options = WriteOptions::new()
            .library(format!("ecmsk {}", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            // No compression threads, because each would need additional memory.
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

/// Makes the message of a channel: a JSON object with the known values.
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

/// The JSON schema of the messages of a channel. An unknown value is left out of its message, because viewers do not
/// support numbers that may be null.
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
