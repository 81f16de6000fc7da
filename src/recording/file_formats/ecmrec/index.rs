//! The index of a recording in blocks: where its blocks of packets are.
//!
//! A block of the kind [`Kind::Index`] lists the blocks of packets since the previous index, 32 bytes each: the
//! distance from the beginning of the index back to the block, its earliest and latest time in ns, the number of its
//! packets, and 1 if it has orders ([`Header::has_orders`]). Distances stay right if files are joined. A recording that
//! was not ended has no index for its last part; then the headers of all blocks are read.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use super::header::{HEADER_LEN, Header, Kind, MAGIC};
use super::section::End;

/// The number of blocks of packets after which the writer adds an index. \[OURS]
pub(crate) const ENTRIES: usize = 32;
/// The length of an entry of an index, bytes.
const ENTRY: usize = 32;
/// The number of bytes that are read at once while the next block is searched. \[OURS]
const CHUNK: u64 = 64 * 1024;

/// A block of packets, or a piece, in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BlockAt {
    /// The offset of the block, bytes: for the reader in the file, for the writer in its recording. A file may have
    /// several recordings, one after the other.
    pub at: u64,
    pub packets: u32,
    pub has_orders: bool,
    /// Whether the block is a piece, which can be read only after the earlier pieces of the same block.
    pub is_piece: bool,
    /// The earliest and the latest time of the packets, ns.
    pub times_ns: (u64, u64),
}

/// Encodes the index of these blocks. `index_at` is the offset at which the index will be written, counted like
/// [`BlockAt::at`].
pub(crate) fn bytes(blocks: &[BlockAt], index_at: u64) -> Vec<u8> {
    let entry = |block: &BlockAt| {
        let mut entry = [0; ENTRY];
        entry[..8].copy_from_slice(&index_at.saturating_sub(block.at).to_le_bytes());
        entry[8..16].copy_from_slice(&block.times_ns.0.to_le_bytes());
        entry[16..24].copy_from_slice(&block.times_ns.1.to_le_bytes());
        entry[24..28].copy_from_slice(&block.packets.to_le_bytes());
        entry[28] = block.has_orders.into();
        entry
    };
    blocks.iter().flat_map(entry).collect()
}

fn parse(bytes: &[u8], index_at: u64) -> Option<Vec<BlockAt>> {
    let block = |entry: &[u8]| {
        let number = |at: usize| entry[at..].first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        Some(BlockAt {
            at: index_at.checked_sub(number(0))?,
            times_ns: (number(8), number(16)),
            packets: number(24) as u32,
            has_orders: entry[28] & 1 != 0,
            is_piece: false,
        })
    };
    bytes.chunks_exact(ENTRY).map(block).collect()
}

/// Where the blocks of a file are, and of which kinds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Index {
    /// The blocks that begin recordings: offset and length, bytes.
    pub sections: Vec<(u64, u64)>,
    /// The blocks of packets, and pieces, in the order of the file.
    pub blocks: Vec<BlockAt>,
    /// The blocks that end recordings: offset and length, bytes.
    pub ends: Vec<(u64, u64)>,
    /// Whether everything comes from indexes in the file. If not, the headers of all blocks were read.
    pub is_whole: bool,
}

impl Index {
    /// Opens a file; `None` if it is no recording in blocks.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn open(path: &Path) -> io::Result<Option<(File, Self)>> {
        let mut file = File::open(path)?;
        let len = file.metadata()?.len();
        let mut begin = Vec::new();
        (&mut file).take(MAGIC.len() as u64).read_to_end(&mut begin)?;
        if begin != MAGIC {
            return Ok(None);
        }
        let index = Self::read(&mut file, len)?;
        Ok(Some((file, index)))
    }

    /// The index of a file with `len` bytes.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(file: &mut (impl Read + Seek), len: u64) -> io::Result<Self> {
        Ok(match Self::from_end(file, len)? {
            Some(index) => index,
            None => Self::from_headers(file, len)?,
        })
    }

    /// Reads the indexes of the file; `None` if any part of the file has no index.
    fn from_end(file: &mut (impl Read + Seek), len: u64) -> io::Result<Option<Self>> {
        let mut index = Self { is_whole: true, ..Self::default() };
        // Reads the file from its end: the last recording first, and in each recording the last index first.
        let (mut end_at, mut blocks) = (len, Vec::new());
        while end_at > 0 {
            let Some((at, header, bytes)) = block_before(file, end_at)? else { return Ok(None) };
            let end = End::parse(&bytes).filter(|_| header.kind == Some(Kind::End)).unwrap_or_default();
            let Some(section_at) = at.checked_sub(end.length).filter(|section_at| *section_at < at) else {
                return Ok(None);
            };
            let (mut from, mut back) = (at, header.back);
            let mut packets = 0;
            while back > 0 {
                let Some(index_at) = from.checked_sub(back).filter(|index_at| *index_at >= section_at) else {
                    return Ok(None);
                };
                let Some((header, bytes)) = block_at(file, index_at)? else { return Ok(None) };
                // Without this check a file with overlapping blocks could be read again for each of its blocks.
                let is_index = header.kind == Some(Kind::Index) && header.block_len() as u64 <= back;
                let is_inside = |block: &BlockAt| block.at > section_at;
                let found = parse(&bytes, index_at).filter(|found| is_index && found.iter().all(is_inside));
                let Some(found) = found else { return Ok(None) };
                packets += found.iter().map(|block| u64::from(block.packets)).sum::<u64>();
                blocks.push(found);
                (from, back) = (index_at, header.back);
            }
            let Some((header, _)) = block_at(file, section_at)? else { return Ok(None) };
            let is_section = header.kind == Some(Kind::Section) && header.block_len() as u64 <= at - section_at;
            if !is_section || end.packets != packets {
                return Ok(None);
            }
            index.sections.push((section_at, header.block_len() as u64));
            index.ends.push((at, end_at - at));
            end_at = section_at;
        }
        index.sections.reverse();
        index.ends.reverse();
        index.blocks = blocks.into_iter().rev().flatten().collect();
        Ok(Some(index))
    }

    /// Makes the index from the headers of all blocks, for a file without complete indexes. Only the headers are read,
    /// but after a damaged header the file is searched byte by byte for the next one.
    fn from_headers(file: &mut (impl Read + Seek), len: u64) -> io::Result<Self> {
        let mut index = Self::default();
        let (mut at, mut number) = (0, 0);
        while at < len {
            let header = match header_at(file, at)? {
                Some(header) => header,
                None => match next_header(file, at + 1)? {
                    Some((next, header)) => {
                        at = next;
                        header
                    }
                    None => break,
                },
            };
            let has_packets = match header.kind {
                Some(Kind::Section) => {
                    index.sections.push((at, header.block_len() as u64));
                    number = 0;
                    false
                }
                Some(Kind::End) => {
                    index.ends.push((at, header.block_len() as u64));
                    false
                }
                Some(Kind::Packets) => {
                    number = header.number;
                    true
                }
                Some(Kind::Piece) => header.number > number,
                Some(Kind::Index) | None => false,
            };
            if has_packets {
                let Header { packets, has_orders, times_ns, .. } = header;
                let is_piece = header.kind == Some(Kind::Piece);
                index.blocks.push(BlockAt { at, packets, has_orders, is_piece, times_ns });
            }
            at += header.block_len() as u64;
        }
        Ok(index)
    }
}

/// The block that ends at the offset `end_at`, with its own offset and its contents; `None` if no undamaged block ends
/// there. Fails if the file cannot be read.
pub(crate) fn block_before(file: &mut (impl Read + Seek), end_at: u64) -> io::Result<Option<(u64, Header, Vec<u8>)>> {
    let Some(length_at) = end_at.checked_sub(size_of::<u32>() as u64) else { return Ok(None) };
    let mut length = [0; size_of::<u32>()];
    file.seek(SeekFrom::Start(length_at))?;
    file.read_exact(&mut length)?;
    let Some(at) = end_at.checked_sub(u32::from_le_bytes(length).into()) else { return Ok(None) };
    let block = block_at(file, at)?;
    Ok(block.filter(|(header, _)| at + header.block_len() as u64 == end_at).map(|(header, bytes)| (at, header, bytes)))
}

/// The block at an offset, and its contents; `None` if no undamaged block begins there.
fn block_at(file: &mut (impl Read + Seek), at: u64) -> io::Result<Option<(Header, Vec<u8>)>> {
    let Some(header) = header_at(file, at)? else { return Ok(None) };
    let mut bytes = Vec::new();
    file.take(header.length.into()).read_to_end(&mut bytes)?;
    Ok(Some((header, bytes)).filter(|(header, bytes)| crc32fast::hash(bytes) == header.crc))
}

fn header_at(file: &mut (impl Read + Seek), at: u64) -> io::Result<Option<Header>> {
    file.seek(SeekFrom::Start(at))?;
    let mut bytes = Vec::with_capacity(HEADER_LEN);
    file.take(HEADER_LEN as u64).read_to_end(&mut bytes)?;
    Ok(Header::parse(&bytes))
}

/// The offset of the next valid header from `at` on, and the header. `None`: there is none up to the end of the file.
/// All magic numbers in a chunk are tried before the next chunk is read, so that even a file full of magic numbers is
/// read only once.
fn next_header(file: &mut (impl Read + Seek), mut at: u64) -> io::Result<Option<(u64, Header)>> {
    loop {
        file.seek(SeekFrom::Start(at))?;
        let mut bytes = Vec::new();
        file.take(CHUNK).read_to_end(&mut bytes)?;
        let places = bytes.windows(MAGIC.len()).enumerate().filter(|(_, bytes)| **bytes == MAGIC);
        let mut headers = places.filter_map(|(place, _)| Some((at + place as u64, Header::parse(&bytes[place..])?)));
        if let Some(found) = headers.next() {
            return Ok(Some(found));
        }
        if (bytes.len() as u64) < CHUNK {
            return Ok(None);
        }
        at += CHUNK - HEADER_LEN as u64 + 1;
    }
}

#[cfg(test)]
mod tests {
    use super::super::section::Section;
    use super::*;

    /// A file in memory that counts the bytes that are read from it.
    struct Counted(io::Cursor<Vec<u8>>, u64);

    impl Read for Counted {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let read = self.0.read(buffer)?;
            self.1 += read as u64;
            Ok(read)
        }
    }

    impl Seek for Counted {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }

    fn block(kind: Kind, back: u64, bytes: &[u8]) -> Vec<u8> {
        let mut block = Vec::new();
        Header { kind: Some(kind), back, ..Header::default() }.write(bytes, &mut block);
        block
    }

    fn section() -> Vec<u8> {
        block(Kind::Section, 0, Section { meta: None, repeated: 0 }.to_text().as_bytes())
    }

    /// A recording of these bytes between its first and its last block. The last index begins at `index_at` in these bytes.
    fn recording(bytes: &[u8], index_at: usize, packets: u64) -> Vec<u8> {
        let section = section();
        let end = End { packets, length: (section.len() + bytes.len()) as u64, ..End::default() };
        let end = block(Kind::End, (bytes.len() - index_at) as u64, end.to_text().as_bytes());
        [&section[..], bytes, &end].concat()
    }

    fn is_whole(file: Vec<u8>) -> bool {
        let len = file.len() as u64;
        Index::read(&mut Counted(io::Cursor::new(file), 0), len).expect("memory can be read").is_whole
    }

    /// An index whose blocks overlap, or that lists a block of another recording, is not used.
    #[test]
    fn an_odd_index_is_not_used() {
        let at = |distance: u64| {
            let mut entry = [0; ENTRY];
            entry[..8].copy_from_slice(&distance.to_le_bytes());
            block(Kind::Index, 0, &entry)
        };
        let packets = block(Kind::Packets, 0, &[0; 2]);
        let own = recording(&[&packets[..], &at(packets.len() as u64)].concat(), packets.len(), 0);
        assert!(is_whole(own.clone()));
        let of_other = recording(&at(section().len() as u64 + 10), 0, 0);
        assert!(!is_whole([&own[..], &of_other].concat()));

        // An index that lies within the contents of the one before it. These are three entries of the outer index, too.
        const BEFORE: usize = 16;
        let inner = block(Kind::Index, (HEADER_LEN + BEFORE) as u64, &[]);
        let mut contents = [&[0; BEFORE][..], &inner].concat();
        contents.resize(3 * ENTRY, 0);
        let entries = parse(&contents, 1000).expect("entries");
        let packets = entries.iter().map(|block| u64::from(block.packets)).sum();
        let outer = block(Kind::Index, 0, &contents);
        assert!(!is_whole(recording(&outer, HEADER_LEN + BEFORE, packets)));
    }

    /// A file without an index is read a few times at most, whatever its contents are.
    #[test]
    fn a_file_of_magic_numbers_is_read_once() {
        let file = [section(), MAGIC.repeat(100_000), section()].concat();
        let len = file.len() as u64;
        let mut file = Counted(io::Cursor::new(file), 0);
        let index = Index::read(&mut file, len).expect("memory can be read");
        assert_eq!(index.sections.len(), 2);
        assert!(file.1 < 2 * len, "{} bytes of {len}", file.1);
    }
}
