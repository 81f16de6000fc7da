//! Reads a file block by block. After damaged bytes, reading goes on at the next block whose CRCs are right.

use std::collections::VecDeque;
use std::io::Read;

use super::compress::decompress;
use super::header::{AROUND, HEADER_LEN, Header, Kind, MAGIC, What};
use super::packing::Unpacker;
use super::section::{End, Section};
use crate::recording::error::RecordError;
use crate::recording::file_formats::container::{Item, Packet};
use crate::recording::file_formats::input::Input;
use crate::recording::file_formats::{exchange, usbmon};
use crate::recording::lacks::Lost;
use crate::recording::meta::{Clock, RecordMeta};
use pcap_file::Endianness;

/// Reads the blocks of a file, and returns their contents as items.
#[derive(Default)]
pub(in crate::recording::file_formats) struct Reader {
    /// Items to return before the packets of the present block.
    items: VecDeque<Item<'static>>,
    unpacker: Unpacker,
    what: What,
    /// The offset of the present block.
    block_at: u64,
    /// Whether a recording has begun: its section block was read, or was lost and replaced.
    in_section: bool,
    /// `number`: the number of the last block of packets that was read. `next_piece`: the piece that can be read next
    /// although it needs earlier ones, by the number of its block and its number among the pieces of that block.
    number: u32,
    next_piece: (u32, u32),
    /// The time of the latest packet, ns. `None`: no packet was read yet.
    latest_ns: Option<u64>,
    /// The unreadable bytes since the last block that was read. `None`: there are none.
    lost: Option<Lost>,
    /// The number of packets returned so far. It is the transfer id of the next packet.
    packets: u64,
    /// The present packet as the reader returns it: the header that it has in pcapng, and its bytes.
    packet: Vec<u8>,
}

impl Reader {
    /// Whether the bytes that are in the memory begin with the magic number of a block, or have a block with a valid
    /// header further on.
    pub fn finds_block<R: Read>(input: &Input<R>) -> bool {
        let bytes = input.bytes();
        let begins = |at: &usize| Header::parse(&bytes[*at..]).is_some();
        bytes.starts_with(&MAGIC) || places(bytes).any(|at| begins(&at))
    }

    /// The next item; `None` at the end of the file. Fails if the file cannot be read; damaged bytes are skipped.
    pub fn next<R: Read>(&mut self, input: &mut Input<R>) -> Result<Option<Item<'_>>, RecordError> {
        loop {
            if let Some(item) = self.items.pop_front() {
                return Ok(Some(item));
            }
            if self.unpacker.left() > 0 {
                return Ok(self.packet().map(Item::Packet));
            }
            if !self.block(input)? {
                return Ok(self.items.pop_front());
            }
        }
    }

    fn packet(&mut self) -> Option<Packet<'_>> {
        self.packet.clear();
        // Callers expect packets as in pcapng, so the header that they have there comes before their bytes.
        let before = match self.what {
            What::Board => usbmon::HEADER_LEN,
            What::Chip => 1,
            What::Network => 0,
        };
        self.packet.resize(before, 0);
        let (dir, at_ns) = self.unpacker.next(&mut self.packet)?;
        match self.what {
            What::Board => self.packet[..before].copy_from_slice(&usbmon::header(dir, self.packets, at_ns)),
            What::Chip => self.packet[0] = exchange::mark(dir),
            What::Network => {}
        }
        self.packets += 1;
        self.latest_ns = Some(at_ns);
        let (link_type, order, offset) = (self.what.link_type(), Endianness::Little, self.block_at);
        Some(Packet { link_type, order, at_ns, offset, data: &self.packet })
    }

    /// Reads the next undamaged block. Returns false at the end of the file.
    fn block<R: Read>(&mut self, input: &mut Input<R>) -> Result<bool, RecordError> {
        loop {
            if !input.has(HEADER_LEN)? {
                self.skip(input, input.bytes().len());
                self.tell_lost(None);
                return Ok(false);
            }
            let Some(header) = Header::parse(input.bytes()) else {
                self.skip_to_block(input);
                continue;
            };
            let is_whole = input.has(header.block_len())? && is_whole(&header, input.bytes());
            if is_whole && header.kind.is_some() && self.take(&header, input.bytes()) {
                self.block_at = input.offset();
                input.advance(header.block_len());
                return Ok(true);
            }
            self.lose(&header);
            // A block that was cut off may be followed by another recording, within the length that its header gives.
            // So only the header is skipped, and the search for a block goes on after it.
            self.skip(input, if is_whole { header.block_len() } else { HEADER_LEN });
        }
    }

    /// Adds a block that cannot be read to `lost`: the number and the times of its packets, from its header.
    fn lose(&mut self, header: &Header) {
        let is_first = self.lost.is_none();
        let lost = self.lost();
        lost.is_newer |= header.kind.is_none();
        lost.packets += u64::from(header.packets);
        if header.packets > 0 {
            let (first_ns, last_ns) = header.times_ns;
            let from_ns = lost.from_ns.filter(|_| !is_first);
            lost.from_ns = Some(from_ns.map_or(first_ns, |from_ns| from_ns.min(first_ns)));
            lost.to_ns = lost.to_ns.max(Some(last_ns));
        }
    }

    fn lost(&mut self) -> &mut Lost {
        let latest_ns = self.latest_ns;
        self.lost.get_or_insert_with(|| Lost { from_ns: latest_ns, ..Lost::default() })
    }

    fn skip<R: Read>(&mut self, input: &mut Input<R>, bytes: usize) {
        if bytes > 0 {
            self.lost().bytes += bytes as u64;
            input.advance(bytes);
        }
    }

    /// Skips bytes up to the next magic number of a block, or up to the end of the bytes in the memory.
    fn skip_to_block<R: Read>(&mut self, input: &mut Input<R>) {
        let found = places(&input.bytes()[1..]).next().map(|at| at + 1);
        // The last bytes in the memory are kept: they may be the beginning of a magic number.
        let all = input.bytes().len();
        let skipped = found.unwrap_or_else(|| all.saturating_sub(MAGIC.len() - 1).max(1));
        self.skip(input, skipped);
    }

    /// Adds an item about the unreadable bytes, if there were any. `next_ns`: the time of the first packet after them,
    /// if it is known.
    fn tell_lost(&mut self, next_ns: Option<u64>) {
        if let Some(mut lost) = self.lost.take() {
            lost.to_ns = lost.to_ns.or(next_ns);
            self.items.push_back(Item::Lost(lost));
        }
    }

    /// Processes a block whose CRCs are right. Returns false if its contents are invalid nevertheless, or need a piece
    /// that was lost.
    fn take(&mut self, header: &Header, block: &[u8]) -> bool {
        let bytes = &block[HEADER_LEN..][..header.length as usize];
        let known = match header.kind {
            Some(Kind::Section) => self.section(header, bytes),
            Some(Kind::Packets) => self.block_of_packets(header, bytes),
            Some(Kind::Piece) => self.piece(header, bytes),
            Some(Kind::End) => End::parse(bytes).map(|End { missing, why, .. }| {
                self.tell_lost(None);
                self.items.push_back(Item::Counts { missing, why: why.filter(|_| missing > 0) });
            }),
            // An index only helps to find blocks and has no packets, so it is skipped.
            Some(Kind::Index) => Some(()),
            None => None,
        };
        known.is_some()
    }

    fn section(&mut self, header: &Header, bytes: &[u8]) -> Option<()> {
        let section = Section::parse(bytes)?;
        self.tell_lost(None);
        self.begin_section(header.what, section.meta);
        (self.number, self.next_piece) = (0, (1, 0));
        Some(())
    }

    fn begin_section(&mut self, what: What, meta: Option<RecordMeta>) {
        self.items.push_back(Item::Section(meta, true));
        self.items.push_back(Item::Interface(what.link_type()));
        (self.what, self.in_section) = (what, true);
    }

    /// If the block that begins the recording was lost, begins a section without slot size and link. The kind of
    /// traffic is in the header of every block.
    fn begin_unknown_section(&mut self, header: &Header) {
        if !self.in_section {
            let meta = RecordMeta {
                slot: None,
                clock: Clock::Real,
                base_ns: 0,
                opened_ns: None,
                link: String::new(),
                machine: None,
            };
            self.begin_section(header.what, Some(meta));
        }
    }

    fn block_of_packets(&mut self, header: &Header, bytes: &[u8]) -> Option<()> {
        let unpacked = if header.is_compressed { decompress(bytes, header.unpacked as usize) } else { None };
        let bytes = unpacked.as_deref().or_else(|| (!header.is_compressed).then_some(bytes))?;
        self.unpacker.begin(header.times_ns.0);
        self.unpacker.take(header.version, bytes).ok()?;
        self.begin_unknown_section(header);
        self.tell_lost(Some(header.times_ns.0));
        (self.number, self.next_piece) = (header.number, (header.number.wrapping_add(1), 0));
        Some(())
    }

    fn piece(&mut self, header: &Header, bytes: &[u8]) -> Option<()> {
        if header.number <= self.number {
            // The rest of old pieces, which the block with the same packets has overwritten in part: the writer was
            // killed before it could cut the rest off.
            return Some(());
        }
        if header.piece == 0 {
            self.unpacker.begin(header.times_ns.0);
        } else if (header.number, header.piece) != self.next_piece {
            return None;
        }
        // If this piece cannot be read, the next one cannot either, because it is stored as differences from this one.
        self.next_piece = (0, 0);
        self.unpacker.take(header.version, bytes).ok()?;
        self.begin_unknown_section(header);
        self.tell_lost(Some(header.times_ns.0));
        self.next_piece = (header.number, header.piece.wrapping_add(1));
        Some(())
    }
}

/// The offsets at which [`MAGIC`] begins in `bytes`.
fn places(bytes: &[u8]) -> impl Iterator<Item = usize> {
    bytes.windows(MAGIC.len()).enumerate().filter(|(_, bytes)| **bytes == MAGIC).map(|(at, _)| at)
}

/// Whether the trailer and the CRC of the contents agree with the header of a block.
fn is_whole(header: &Header, block: &[u8]) -> bool {
    let bytes = &block[HEADER_LEN..][..header.length as usize];
    let end = block[AROUND - size_of::<u32>() + bytes.len()..].first_chunk();
    end == Some(&(header.block_len() as u32).to_le_bytes()) && crc32fast::hash(bytes) == header.crc
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Recording;

    /// A file may have any number in a header whose CRC is right.
    #[test]
    fn the_last_number_of_a_block_is_no_panic() {
        let mut file = Vec::new();
        for kind in [Kind::Packets, Kind::Piece, Kind::Packets] {
            let header = Header { kind: Some(kind), number: u32::MAX, unpacked: 2, ..Header::default() };
            header.write(&[0; 2], &mut file);
        }
        let mut recording = Recording::new(&file[..], "").expect("a recording");
        assert_eq!(recording.by_ref().count(), 0);
        assert_eq!(recording.lacks().damage.count, 0);
    }
}
