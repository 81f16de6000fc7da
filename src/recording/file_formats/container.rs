//! Reads the container around the packets of a capture, pcapng, the older pcap or [`ecmrec`](super::ecmrec), block by
//! block from any source.
//!
//! The crate `pcap-file` parses the blocks. This file adds what it lacks: the offsets of blocks in the file, time units
//! other than nanoseconds, and skipping blocks that are not needed.

use std::borrow::Cow;
use std::io::Read;
use std::sync::Arc;

use pcap_file::pcap::PcapParser;
use pcap_file::pcapng::blocks::interface_description::{InterfaceDescriptionBlock, InterfaceDescriptionOption};
use pcap_file::pcapng::blocks::interface_statistics::InterfaceStatisticsOption;
use pcap_file::pcapng::blocks::section_header::{SectionHeaderBlock, SectionHeaderOption};
use pcap_file::pcapng::blocks::{
    ENHANCED_PACKET_BLOCK, INTERFACE_DESCRIPTION_BLOCK, INTERFACE_STATISTIC_BLOCK, SECTION_HEADER_BLOCK,
};
use pcap_file::pcapng::{Block, PcapNgParser};
use pcap_file::{DataLink, Endianness, PcapError, TsResolution};

use super::ecmrec::reader::Reader;
use super::input::Input;
use super::number;
use crate::recording::error::RecordError;
use crate::recording::lacks::Lost;
use crate::recording::meta::{APPLICATION, CarriedFile, RecordMeta};

/// Longest block that is read into memory. \[OURS] Real blocks are a thousand times shorter.
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
    /// The statistics of an interface, at the end of a section: how many packets the recorder did not write, and why.
    Counts { missing: u64, why: Option<String> },
    /// Bytes of the file that cannot be read, because they are damaged or a newer version wrote them.
    Lost(Lost),
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
    Ecmrec(Box<Reader>),
}

/// Reads a file block by block.
pub(in crate::recording) struct Blocks<R> {
    input: Input<R>,
    /// The parser; `None` before the first block.
    parser: Option<Parser>,
}

impl<R: Read> Blocks<R> {
    pub fn new(source: R, name: String) -> Self {
        Self { input: Input::new(source, name), parser: None }
    }

    /// Reads the next block and parses it; `None` at the end of the file. Fails if the file cannot be read or a block
    /// is damaged.
    pub fn next(&mut self) -> Result<Option<Item<'_>>, RecordError> {
        let Self { input, parser } = self;
        let parser = match parser {
            Some(parser) => parser,
            None => {
                *parser = Some(begin(input)?);
                match parser {
                    Some(Parser::PcapNg(parser)) => return Ok(Some(section(parser.section()))),
                    Some(Parser::Pcap(parser)) => return Ok(Some(Item::Interface(parser.header().datalink))),
                    Some(parser) => parser,
                    None => return Ok(None),
                }
            }
        };
        if let Parser::Ecmrec(reader) = parser {
            return reader.next(input);
        }
        if input.bytes().is_empty() && !input.fill()? {
            return Ok(None);
        }
        let len = loop {
            match measure(parser, input.bytes()) {
                Ok(len) => break len,
                Err(PcapError::IncompleteBuffer) => fill_more(input)?,
                Err(error) => return Err(malformed(input.name(), input.offset(), &error)),
            }
        };
        let offset = input.offset();
        input.advance(len);
        let block = input.passed(len);
        let item = match parser {
            Parser::PcapNg(parser) => pcapng_item(parser, block, offset),
            Parser::Pcap(parser) => pcap_item(parser, block, offset),
            Parser::Ecmrec(_) => Ok(Item::Other),
        };
        item.map(Some).map_err(|error| malformed(input.name(), offset, &error))
    }
}

/// Reads the header of the file, which shows its format.
fn begin<R: Read>(input: &mut Input<R>) -> Result<Parser, RecordError> {
    while input.bytes().len() < size_of::<u32>() {
        if !input.fill()? {
            return Err(RecordError::NotACapture { name: input.name().to_owned() });
        }
    }
    let is_pcapng = input.bytes().starts_with(&SECTION_HEADER_BLOCK.to_be_bytes());
    let (parser, rest) = loop {
        // The kind of the first block is checked here, because the pcapng parser would accept any kind.
        let parsed = if is_pcapng {
            PcapNgParser::new(input.bytes()).map(|(rest, parser)| (Parser::PcapNg(parser), rest.len()))
        } else {
            PcapParser::new(input.bytes()).map(|(rest, parser)| (Parser::Pcap(parser), rest.len()))
        };
        match parsed {
            Ok(parsed) => break parsed,
            Err(PcapError::IncompleteBuffer) if is_pcapng => fill_more(input)?,
            Err(PcapError::IncompleteBuffer) if input.fill()? => {}
            // The file is neither pcapng nor pcap. It may be a recording in blocks whose first block is damaged, so the
            // next bytes are searched for a block, too.
            Err(_) if !is_pcapng && Reader::finds_block(input) => return Ok(Parser::Ecmrec(Box::default())),
            Err(_) if !is_pcapng => return Err(RecordError::NotACapture { name: input.name().to_owned() }),
            Err(error) => return Err(malformed(input.name(), 0, &error)),
        }
    };
    input.advance(input.bytes().len() - rest);
    Ok(parser)
}

/// The length of the next block. The parser also reads section and interface blocks here: it needs their contents for
/// the packets that follow.
fn measure(parser: &mut Parser, bytes: &[u8]) -> Result<usize, PcapError> {
    let rest = match parser {
        Parser::PcapNg(parser) => parser.next_raw_block(bytes)?.0,
        Parser::Pcap(parser) => parser.next_raw_packet(bytes)?.0,
        Parser::Ecmrec(_) => bytes,
    };
    Ok(bytes.len() - rest.len())
}

/// Reads more of the current block into the buffer.
fn fill_more<R: Read>(input: &mut Input<R>) -> Result<(), RecordError> {
    if input.bytes().len() > LONGEST_BLOCK {
        let reason = PcapError::InvalidField("a block of more than 16 MiB");
        return Err(malformed(input.name(), input.offset(), &reason));
    }
    if input.fill()? {
        Ok(())
    } else {
        Err(RecordError::Truncated { name: input.name().to_owned(), offset: input.offset() })
    }
}

fn malformed(name: &str, offset: u64, reason: &PcapError) -> RecordError {
    RecordError::Malformed { name: name.to_owned(), offset, reason: reason.to_string() }
}

fn section(header: &SectionHeaderBlock<'_>) -> Item<'static> {
    let comments = || {
        header.options.iter().filter_map(|option| match option {
            SectionHeaderOption::Comment(comment) => Some(&**comment),
            _ => None,
        })
    };
    let meta = comments().find_map(RecordMeta::from_comment);
    let machine = || CarriedFile::from_comments(comments()).map(Arc::new);
    let meta = meta.map(|meta| RecordMeta { machine: machine(), ..meta });
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
                    // The comment has the form `570 frames are missing: why`, so the reason follows the first colon.
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
            // The option's value is a signed number of seconds, which the crate returns as unsigned, so it is converted
            // back.
            InterfaceDescriptionOption::IfTsOffset(seconds) => offset_s = i128::from(*seconds as i64),
            _ => {}
        }
    }
    let exponent = u32::from(resolution & !BINARY);
    let base: u128 = if resolution & BINARY == 0 { 10 } else { 2 };
    // With units so small that `base` to the power of `exponent` exceeds 128 bits, every 64-bit time is less than 1 ns.
    let ns = base.checked_pow(exponent).map_or(0, |per_second| units * NS_PER_S / per_second);
    let ns = i128::try_from(ns).unwrap_or(i128::MAX).saturating_add(offset_s * NS_PER_S as i128);
    u64::try_from(ns.max(0)).unwrap_or(u64::MAX)
}
