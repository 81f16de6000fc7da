//! The header and the trailer of a block. Between them are the contents of the block, which depend on its [`Kind`].
//!
//! | bytes | meaning |
//! | --- | --- |
//! | 0..8 | [`MAGIC`] |
//! | 8 | version of the contents; the header is the same in all versions |
//! | 9 | [`Kind`] |
//! | 10 | 1: the contents are compressed |
//! | 11 | bit 0: [`Header::has_orders`]; bits 1, 2: [`What`] |
//! | 12..16 | [`Header::number`]: blocks of packets count from 1 |
//! | 16..20 | length of the contents in the file, bytes |
//! | 20..24 | length of the contents when they are uncompressed, bytes |
//! | 24..28 | number of packets in the block |
//! | 28..32 | [`Header::piece`] |
//! | 32..40 | earliest time of the packets, ns |
//! | 40..48 | latest time of the packets, ns |
//! | 48..56 | [`Header::back`], bytes |
//! | 56..60 | CRC-32 of the contents as they are in the file |
//! | 60..64 | CRC-32 of bytes 0..60 of the header |
//!
//! The trailer is the length of the whole block, 32 bits, so that a file can be read from its end. Numbers are little
//! endian.

use bytemuck::{Pod, Zeroable};
use pcap_file::DataLink;

use crate::recording::file_formats::exchange;

/// The first bytes of each block. No text file begins with the byte 0x89, and a transfer that converts line ends
/// damages the last byte.
pub(crate) const MAGIC: [u8; 8] = *b"\x89ECMREC\n";
/// The version of blocks that this crate writes, and the newest that it reads. Version 1 has no second differences.
pub(crate) const VERSION: u8 = 2;
/// The length of a header, bytes.
pub(crate) const HEADER_LEN: usize = size_of::<RawHeader>();
/// The length of header and trailer together, bytes.
pub(crate) const AROUND: usize = HEADER_LEN + size_of::<u32>();
/// The most bytes that the contents of a block may have, in the file and uncompressed; a header with more is invalid.
/// \[OURS] Blocks that this crate writes have at most about a tenth of this.
pub(crate) const BYTES_MAX: usize = 16 << 20;

/// The kind of a block: what its contents are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The beginning of a recording: the metadata of the recording.
    #[default]
    Section,
    /// Packets of one block, readable without any other block.
    Packets,
    /// The newest packets of a recording, written at once. When there are enough of them, one block of packets replaces
    /// all pieces. Piece 0 can be read alone; each further piece only after all earlier pieces of the same block.
    Piece,
    /// A list of blocks of packets: offsets and times. [`Header::back`] leads to the previous index; 0: this is the
    /// first one.
    Index,
    /// The end of a recording: counts of packets. [`Header::back`] leads to the last index; 0: there is none.
    End,
}

/// The kinds of blocks. The index is the code in the header.
const KINDS: [Kind; 5] = [Kind::Section, Kind::Packets, Kind::Piece, Kind::Index, Kind::End];

/// The kind of traffic that was recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum What {
    /// Frames of an ECM-SK.
    #[default]
    Board,
    /// Packets of an ECM-XF.
    Chip,
    /// Frames of a network.
    Network,
}

impl What {
    /// The link type that these packets have in pcapng, and in which the reader returns them.
    pub const fn link_type(self) -> DataLink {
        match self {
            Self::Board => DataLink::USB_LINUX_MMAPPED,
            Self::Chip => exchange::LINK_TYPE,
            Self::Network => DataLink::ETHERNET,
        }
    }
}

/// The decoded header of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Header {
    /// The kind of the block; `None` if a newer version of the format wrote it.
    pub kind: Option<Kind>,
    /// The version of the contents. Blocks are written with [`VERSION`], whatever this says.
    pub version: u8,
    pub is_compressed: bool,
    pub what: What,
    /// Whether the block has a frame whose slot 0 is a command other than GET_STATUS. Such commands configure the
    /// board, so later frames can be understood only with them.
    pub has_orders: bool,
    /// For a block of packets, its number in the recording, from 1. For a piece, the number that the block of packets
    /// will have that replaces it. For other kinds, the number of the last block of packets before it.
    pub number: u32,
    /// The number of the piece among those of the same block, from 0.
    pub piece: u32,
    /// The length of the contents in the file, bytes.
    pub length: u32,
    /// The length of the contents when they are uncompressed, bytes.
    pub unpacked: u32,
    pub packets: u32,
    /// The earliest and the latest time of the packets, ns.
    pub times_ns: (u64, u64),
    /// The distance from the beginning of this block back to the beginning of an index, bytes, see [`Kind::Index`] and
    /// [`Kind::End`].
    pub back: u64,
    /// The CRC-32 of the contents as they are in the file.
    pub crc: u32,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RawHeader {
    magic: [u8; 8],
    version: u8,
    kind: u8,
    is_compressed: u8,
    flags: u8,
    number: [u8; 4],
    length: [u8; 4],
    unpacked: [u8; 4],
    packets: [u8; 4],
    piece: [u8; 4],
    first_ns: [u8; 8],
    last_ns: [u8; 8],
    back: [u8; 8],
    crc: [u8; 4],
    header_crc: [u8; 4],
}

const HAS_ORDERS: u8 = 1;
const OF_CHIP: u8 = 2;
const OF_NETWORK: u8 = 4;
const CRC_AT: usize = std::mem::offset_of!(RawHeader, header_crc);
const _: () = assert!(HEADER_LEN == 64 && align_of::<RawHeader>() == 1);

impl Header {
    /// The length of the whole block, bytes.
    pub const fn block_len(&self) -> usize {
        AROUND + self.length as usize
    }

    /// Decodes the header at the beginning of `bytes`; `None` if there is none, or it is damaged.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let raw: &RawHeader = bytemuck::from_bytes(bytes.get(..HEADER_LEN)?);
        if raw.magic != MAGIC || crc32fast::hash(&bytes[..CRC_AT]) != u32::from_le_bytes(raw.header_crc) {
            return None;
        }
        let kind = KINDS.get(usize::from(raw.kind)).copied().filter(|_| raw.version <= VERSION);
        let what = match raw.flags & (OF_CHIP | OF_NETWORK) {
            OF_CHIP => What::Chip,
            OF_NETWORK => What::Network,
            _ => What::Board,
        };
        let header = Self {
            kind,
            version: raw.version,
            what,
            is_compressed: raw.is_compressed != 0,
            has_orders: raw.flags & HAS_ORDERS != 0,
            number: u32::from_le_bytes(raw.number),
            piece: u32::from_le_bytes(raw.piece),
            length: u32::from_le_bytes(raw.length),
            unpacked: u32::from_le_bytes(raw.unpacked),
            packets: u32::from_le_bytes(raw.packets),
            times_ns: (u64::from_le_bytes(raw.first_ns), u64::from_le_bytes(raw.last_ns)),
            back: u64::from_le_bytes(raw.back),
            crc: u32::from_le_bytes(raw.crc),
        };
        (header.length.max(header.unpacked) as usize <= BYTES_MAX).then_some(header)
    }

    /// Appends to `out` the block with `bytes` as its contents. Sets the length and the CRC in the header from `bytes`.
    pub fn write(mut self, bytes: &[u8], out: &mut Vec<u8>) {
        self.length = bytes.len() as u32;
        self.crc = crc32fast::hash(bytes);
        let begin = out.len();
        out.extend(bytemuck::bytes_of(&self.raw()));
        let crc = crc32fast::hash(&out[begin..begin + CRC_AT]);
        out[begin + CRC_AT..].copy_from_slice(&crc.to_le_bytes());
        out.extend(bytes);
        out.extend((self.block_len() as u32).to_le_bytes());
    }

    fn raw(&self) -> RawHeader {
        let kind = self.kind.unwrap_or_default();
        let what = match self.what {
            What::Board => 0,
            What::Chip => OF_CHIP,
            What::Network => OF_NETWORK,
        };
        RawHeader {
            magic: MAGIC,
            version: VERSION,
            kind: KINDS.iter().position(|known| *known == kind).unwrap_or_default() as u8,
            is_compressed: self.is_compressed.into(),
            flags: what | if self.has_orders { HAS_ORDERS } else { 0 },
            number: self.number.to_le_bytes(),
            length: self.length.to_le_bytes(),
            unpacked: self.unpacked.to_le_bytes(),
            packets: self.packets.to_le_bytes(),
            piece: self.piece.to_le_bytes(),
            first_ns: self.times_ns.0.to_le_bytes(),
            last_ns: self.times_ns.1.to_le_bytes(),
            back: self.back.to_le_bytes(),
            crc: self.crc.to_le_bytes(),
            header_crc: [0; 4],
        }
    }
}
