//! Reads the container around the packets of a capture, pcapng or the older pcap, block by block from any source.
//!
//! The crate `pcap-file` parses the blocks. This file adds what it lacks: the offsets of blocks in the file, time units
//! other than nanoseconds, and skipping blocks that are not needed.

use std::borrow::Cow;
use std::io::{ErrorKind, Read};

use pcap_file::pcap::PcapParser;
use pcap_file::pcapng::blocks::interface_description::{InterfaceDescriptionBlock, InterfaceDescriptionOption};
use pcap_file::pcapng::blocks::interface_statistics::InterfaceStatisticsOption;
use pcap_file::pcapng::blocks::section_header::{SectionHeaderBlock, SectionHeaderOption};
use pcap_file::pcapng::blocks::{
    ENHANCED_PACKET_BLOCK, INTERFACE_DESCRIPTION_BLOCK, INTERFACE_STATISTIC_BLOCK, SECTION_HEADER_BLOCK,
};
use pcap_file::pcapng::{Block, PcapNgParser};
use pcap_file::{DataLink, Endianness, PcapError, TsResolution};

use super::number;
use crate::recording::error::RecordError;
use crate::recording::meta::{APPLICATION, RecordMeta};

/// The number of bytes read at a time. \[OURS]
const CHUNK: usize = 64 * 1024;
/// Longest block that is read into memory. \[OURS] Real ones are a thousand times shorter.
const LONGEST_BLOCK: usize = 16 * 1024 * 1024;

const NS_PER_S: u128 = 1_000_000_000;

/// What a block contains, as far as the reader needs it.
pub(in crate::recording) enum Item<'a> {
    /// The header of a section. The first field: its metadata, if the section is a recording. The second: whether the
    /// recorder of this crate wrote it.
    Section(Option<RecordMeta>, bool),
    /// The description of an interface: the link type of its packets.
    Interface(DataLink),
    /// A captured packet.
    Packet(Packet<'a>),
    /// The statistics of an interface, at the end of a section: how many packets are missing, and why.
    Counts { missing: u64, why: Option<String> },
    /// A block that is not needed.
    Other,
}

/// A captured packet.
pub(in crate::recording) struct Packet<'a> {
    pub link_type: DataLink,
    /// The byte order of the numbers in the header before the data.
    pub order: Endianness,
    /// The time of the packet in nanoseconds, as the file has it: usually since 1970-01-01.
    pub at_ns: u64,
    /// The offset of the packet's block in the file.
    pub offset: u64,
    pub data: &'a [u8],
}

enum Parser {
    PcapNg(PcapNgParser),
    Pcap(PcapParser),
}

/// Reads a file block by block.
pub(in crate::recording) struct Blocks<R> {
    source: R,
    /// The name of the file, for messages.
    name: String,
    buffer: Vec<u8>,
    /// The offset of the next block in the buffer, and in the file.
    start: usize,
    offset: u64,
    /// The parser; `None` before the first block.
    parser: Option<Parser>,
}

impl<R: Read> Blocks<R> {
    pub fn new(source: R, name: String) -> Self {
        Self { source, name, buffer: Vec::new(), start: 0, offset: 0, parser: None }
    }

    /// Reads the next block and parses it; `None` at the end of the file.
    pub fn next(&mut self) -> Result<Option<Item<'_>>, RecordError> {
        if self.parser.is_none() {
            return self.begin().map(Some);
        }
        if self.start == self.buffer.len() && !self.fill()? {
            return Ok(None);
        }
        let end = loop {
            match self.measure() {
                Ok(len) => break self.start + len,
                Err(PcapError::IncompleteBuffer) => self.fill_more()?,
                Err(error) => return Err(malformed(&self.name, self.offset, &error)),
            }
        };
        let block = &self.buffer[self.start..end];
        let offset = self.offset;
        self.start = end;
        self.offset += block.len() as u64;
        let item = match &mut self.parser {
            Some(Parser::PcapNg(parser)) => pcapng_item(parser, block, offset),
            Some(Parser::Pcap(parser)) => pcap_item(parser, block, offset),
            None => Ok(Item::Other),
        };
        item.map(Some).map_err(|error| malformed(&self.name, offset, &error))
    }

    /// Reads the header of the file, which shows whether it is pcapng or pcap.
    fn begin(&mut self) -> Result<Item<'_>, RecordError> {
        while self.buffer.len() < size_of::<u32>() {
            if !self.fill()? {
                return Err(RecordError::NotACapture { name: self.name.clone() });
            }
        }
        let is_pcapng = self.buffer.starts_with(&SECTION_HEADER_BLOCK.to_be_bytes());
        let (parser, rest) = loop {
            // The kind of the first block is checked here, because the pcapng parser would accept any kind.
            let parsed = if is_pcapng {
                PcapNgParser::new(&self.buffer).map(|(rest, parser)| (Parser::PcapNg(parser), rest.len()))
            } else {
                PcapParser::new(&self.buffer).map(|(rest, parser)| (Parser::Pcap(parser), rest.len()))
            };
            match parsed {
                Ok(parsed) => break parsed,
                Err(PcapError::IncompleteBuffer) if is_pcapng => self.fill_more()?,
                Err(PcapError::IncompleteBuffer) if self.fill()? => {}
                Err(_) if !is_pcapng => return Err(RecordError::NotACapture { name: self.name.clone() }),
                Err(error) => return Err(malformed(&self.name, 0, &error)),
            }
        };
        self.start = self.buffer.len() - rest;
        self.offset = self.start as u64;
        Ok(match self.parser.insert(parser) {
            Parser::PcapNg(parser) => section(parser.section()),
            Parser::Pcap(parser) => Item::Interface(parser.header().datalink),
        })
    }

    /// The length of the next block. Section and interface blocks are also parsed, because the parser keeps their content.
    fn measure(&mut self) -> Result<usize, PcapError> {
        let bytes = &self.buffer[self.start..];
        let rest = match &mut self.parser {
            Some(Parser::PcapNg(parser)) => parser.next_raw_block(bytes)?.0,
            Some(Parser::Pcap(parser)) => parser.next_raw_packet(bytes)?.0,
            None => bytes,
        };
        Ok(bytes.len() - rest.len())
    }

    /// Reads more of the current block into the buffer.
    fn fill_more(&mut self) -> Result<(), RecordError> {
        if self.buffer.len() - self.start > LONGEST_BLOCK {
            let reason = PcapError::InvalidField("a block of more than 16 MiB");
            return Err(malformed(&self.name, self.offset, &reason));
        }
        if self.fill()? { Ok(()) } else { Err(RecordError::Truncated { name: self.name.clone(), offset: self.offset }) }
    }

    /// Reads the next chunk into the buffer. Returns whether there was anything left to read.
    fn fill(&mut self) -> Result<bool, RecordError> {
        self.buffer.drain(..self.start);
        self.start = 0;
        let len = self.buffer.len();
        self.buffer.resize(len + CHUNK, 0);
        let read = loop {
            match self.source.read(&mut self.buffer[len..]) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                read => break read,
            }
        };
        self.buffer.truncate(len + *read.as_ref().unwrap_or(&0));
        match read {
            Ok(read) => Ok(read > 0),
            Err(error) => Err(RecordError::Io { name: self.name.clone(), message: error.to_string() }),
        }
    }
}

fn malformed(name: &str, offset: u64, reason: &PcapError) -> RecordError {
    RecordError::Malformed { name: name.to_owned(), offset, reason: reason.to_string() }
}

fn section(header: &SectionHeaderBlock<'_>) -> Item<'static> {
    let meta = header.options.iter().find_map(|option| match option {
        SectionHeaderOption::Comment(comment) => RecordMeta::from_comment(comment),
        _ => None,
    });
    let ours = |option: &SectionHeaderOption<'_>| match option {
        SectionHeaderOption::UserApplication(name) => name.starts_with(APPLICATION),
        _ => false,
    };
    Item::Section(meta, header.options.iter().any(ours))
}

fn pcap_item<'a>(parser: &PcapParser, block: &'a [u8], offset: u64) -> Result<Item<'a>, PcapError> {
    let header = parser.header();
    let (_, packet) = parser.next_raw_packet(block)?;
    let unit = if header.ts_resolution == TsResolution::NanoSecond { 1 } else { 1000 };
    let at_ns = u64::from(packet.ts_sec) * NS_PER_S as u64 + u64::from(packet.ts_frac) * unit;
    let Cow::Borrowed(data) = packet.data else { return Ok(Item::Other) };
    Ok(Item::Packet(Packet { link_type: header.datalink, order: header.endianness, at_ns, offset, data }))
}

/// Parses one complete block.
fn pcapng_item<'a>(parser: &mut PcapNgParser, block: &'a [u8], offset: u64) -> Result<Item<'a>, PcapError> {
    let order = parser.section().endianness;
    // Only blocks that are needed are parsed, since the parser would reject the whole file for an error in any block.
    match field(order, block, BLOCK_TYPE)? {
        SECTION_HEADER_BLOCK => return Ok(section(parser.section())),
        INTERFACE_DESCRIPTION_BLOCK => {
            let newest = parser.interfaces().last();
            return Ok(newest.map_or(Item::Other, |interface| Item::Interface(interface.linktype)));
        }
        // The parser adds length and padding, which could overflow where `usize` has 32 bits. So a wrong length is
        // rejected here.
        ENHANCED_PACKET_BLOCK if field(order, block, CAPTURED_LENGTH)? as usize > block.len() => {
            return Err(PcapError::InvalidField("EnhancedPacketBlock: captured_len > block length"));
        }
        ENHANCED_PACKET_BLOCK | INTERFACE_STATISTIC_BLOCK => {}
        _ => return Ok(Item::Other),
    }
    match parser.next_block(block)?.1 {
        Block::EnhancedPacket(packet) => {
            let unknown = PcapError::InvalidInterfaceId(packet.interface_id);
            let interface = parser.packet_interface(&packet).ok_or(unknown)?;
            // The crate interprets the time as nanoseconds, so `as_nanos` returns the number of the interface's units.
            let at_ns = nanoseconds(packet.timestamp.as_nanos(), interface);
            let Cow::Borrowed(data) = packet.data else { return Ok(Item::Other) };
            Ok(Item::Packet(Packet { link_type: interface.linktype, order, at_ns, offset, data }))
        }
        Block::InterfaceStatistics(statistics) => {
            let (mut missing, mut why) = (0, None);
            for option in &statistics.options {
                match option {
                    InterfaceStatisticsOption::IsbIfDrop(n) => missing = *n,
                    // The comment has the form `570 frames are missing: why`.
                    InterfaceStatisticsOption::Comment(words) => {
                        why = words.split_once(": ").map(|(_, why)| why.to_owned());
                    }
                    _ => {}
                }
            }
            Ok(Item::Counts { missing, why: why.filter(|_| missing > 0) })
        }
        _ => Ok(Item::Other),
    }
}

/// The offsets of the block type and of the captured length in a block.
const BLOCK_TYPE: usize = 0;
const CAPTURED_LENGTH: usize = 20;

fn field(order: Endianness, block: &[u8], at: usize) -> Result<u32, PcapError> {
    let bytes = block.get(at..).and_then(|rest| rest.first_chunk());
    bytes.map(|bytes| number(order, *bytes)).ok_or(PcapError::InvalidField("block too short"))
}

/// Converts a time in the units of the interface, microseconds by default, to nanoseconds. A time that does not fit
/// saturates.
fn nanoseconds(units: u128, interface: &InterfaceDescriptionBlock<'_>) -> u64 {
    const MICROSECONDS: u8 = 6;
    const BINARY: u8 = 0x80;
    let mut resolution = MICROSECONDS;
    let mut offset_s = 0;
    for option in &interface.options {
        match option {
            InterfaceDescriptionOption::IfTsResol(exponent) => resolution = *exponent,
            // The option's value is a signed number of seconds, which the crate returns as unsigned.
            InterfaceDescriptionOption::IfTsOffset(seconds) => offset_s = i128::from(*seconds as i64),
            _ => {}
        }
    }
    let exponent = u32::from(resolution & !BINARY);
    let base: u128 = if resolution & BINARY == 0 { 10 } else { 2 };
    // If the units are so small that the power overflows, every 64-bit time is 0 ns.
    let ns = base.checked_pow(exponent).map_or(0, |per_second| units * NS_PER_S / per_second);
    let ns = i128::try_from(ns).unwrap_or(i128::MAX).saturating_add(offset_s * NS_PER_S as i128);
    u64::try_from(ns.max(0)).unwrap_or(u64::MAX)
}
