//! Writes a recording in the format for weeks ([`ecmrec`](crate::recording::file_formats::ecmrec)).
//!
//! New entries go to the file at once, as a piece: packed, but hardly compressed. Once there are enough of them a
//! compressed block replaces the pieces. So a program that is killed leaves all but its last milliseconds in the file, and
//! the file is small all the same. A pipe keeps the pieces.

use std::io;

use super::file::Sink;
use super::loss::Loss;
use super::writer::{Entry, SECTION_END_BYTES_MAX, SORTED_FRAMES, Writer};
use crate::recording::file_formats::ecmrec::compress::Compressor;
use crate::recording::file_formats::ecmrec::header::{Header, Kind};
use crate::recording::file_formats::ecmrec::index::{self, BlockAt};
use crate::recording::file_formats::ecmrec::packing::{Packer, Packet};
use crate::recording::file_formats::ecmrec::section::{End, Section};
use crate::recording::{Clock, RecordMeta};

/// The number of entries of a block: half a second of both directions with a cycle of 1 ms. \[OURS]
const BLOCK: usize = 1024;

/// A recording that is being written.
pub(super) struct BlockWriter<E> {
    loss: Loss,
    sink: Sink,
    /// Whether entries are stored in the order of their times.
    sorts: bool,
    /// The entries of the present block. On the real clock the newest ones stay here for the next block, because an
    /// entry that comes late may belong before them.
    entries: Vec<E>,
    /// The number of them that are in the file as pieces.
    in_pieces: usize,
    /// The number of pieces in the file, and of their bytes.
    pieces: u32,
    pieces_bytes: u64,
    /// The number of blocks, and of their packets.
    number: u32,
    packets: u64,
    /// The bytes of the recording without the pieces.
    length: u64,
    /// The last block if it is still the end of those bytes: its length and its packets.
    last_block: Option<(u64, u64)>,
    /// The blocks that no index in the file has.
    index: Vec<BlockAt>,
    /// The offset of the last index in the recording; 0 if there is none.
    index_at: u64,
    /// The latest time of all entries.
    last_ns: u64,
    pack: Packing,
}

/// What packs and compresses, and its memory.
struct Packing {
    /// For blocks, and for pieces, which continue each other.
    blocks: Packer,
    pieces: Packer,
    compressor: Compressor,
    packed: Vec<u8>,
    compressed: Vec<u8>,
    /// What goes to the file with the next write.
    out: Vec<u8>,
}

impl<E: Entry> BlockWriter<E> {
    /// Writes the beginning of the recording. Fails if the disk has no room for it and for its end.
    pub fn begin(loss: Loss, sink: Sink, meta: &RecordMeta) -> io::Result<Self> {
        let pack = Packing {
            blocks: Packer::default(),
            pieces: Packer::default(),
            compressor: Compressor::new(),
            packed: Vec::new(),
            compressed: Vec::new(),
            out: Vec::new(),
        };
        let mut writer = Self {
            loss,
            sorts: E::MAY_COME_LATE && meta.clock == Clock::Real && sink.can_rewrite(),
            sink,
            entries: Vec::with_capacity(BLOCK + SORTED_FRAMES),
            in_pieces: 0,
            pieces: 0,
            pieces_bytes: 0,
            number: 0,
            packets: 0,
            length: 0,
            last_block: None,
            index: Vec::with_capacity(index::ENTRIES),
            index_at: 0,
            last_ns: 0,
            pack,
        };
        let section = Section { meta: Some(meta.clone()) };
        let header = Header { kind: Some(Kind::Section), what: E::WHAT, ..Header::default() };
        header.write(section.to_text().as_bytes(), &mut writer.pack.out);
        let length = writer.pack.out.len() as u64;
        writer.sink.put(0, &writer.pack.out)?;
        if writer.sink.can_rewrite() {
            if let Err(error) = writer.sink.put(0, &[0; SECTION_END_BYTES_MAX]) {
                // Without its end the recording would look as if the program had been killed.
                writer.sink.truncate_by(length)?;
                return Err(error);
            }
            writer.sink.truncate_by(SECTION_END_BYTES_MAX as u64)?;
        }
        writer.length = length;
        Ok(writer)
    }

    /// The number of newest entries that wait for the next block.
    const fn held_back(&self) -> usize {
        if self.sorts { SORTED_FRAMES } else { 0 }
    }

    /// Writes the entries that are not in the file yet as a piece, in the order in which they came.
    fn write_piece(&mut self) -> io::Result<()> {
        if self.in_pieces == self.entries.len() {
            return Ok(());
        }
        self.pack.out.clear();
        self.add_piece(self.in_pieces, self.in_pieces == 0);
        self.sink.put(0, &self.pack.out)?;
        let len = self.pack.out.len() as u64;
        if self.sink.can_rewrite() {
            self.pieces_bytes += len;
        } else {
            self.length += len;
        }
        self.pieces += 1;
        self.in_pieces = self.entries.len();
        Ok(())
    }

    /// Appends the entries from `from` on to the next write, as the first piece of a block or the next one.
    fn add_piece(&mut self, from: usize, is_first: bool) {
        if is_first {
            self.pieces = 0;
        }
        let header = self.header(Kind::Piece, &self.entries[from..]);
        let Packing { pieces, packed, out, .. } = &mut self.pack;
        if is_first {
            pieces.begin(header.times_ns.0);
        }
        packed.clear();
        pieces.pack(self.entries[from..].iter().map(packet), packed);
        let (number, piece, unpacked) = (self.number + 1, self.pieces, packed.len() as u32);
        Header { number, piece, unpacked, ..header }.write(packed, out);
    }

    fn header(&self, kind: Kind, entries: &[E]) -> Header {
        let times = || entries.iter().map(E::at_ns);
        Header {
            kind: Some(kind),
            what: E::WHAT,
            has_orders: entries.iter().any(E::is_order),
            number: self.number,
            packets: entries.len() as u32,
            times_ns: (times().min().unwrap_or_default(), times().max().unwrap_or_default()),
            ..Header::default()
        }
    }

    /// Replaces the pieces by a block. `held_back` of the newest entries become the first piece of the next block. After an
    /// error all entries are still there, and the pieces in the file may be damaged.
    fn write_block(&mut self, held_back: usize) -> io::Result<()> {
        let count = self.entries.len().saturating_sub(held_back);
        if count == 0 {
            return Ok(());
        }
        if !self.sink.can_rewrite() {
            self.write_piece()?;
            self.written(count);
            return Ok(());
        }
        if self.sorts && !self.entries.is_sorted_by_key(E::key) {
            self.entries.sort_by_key(E::key);
        }
        self.number += 1;
        let block = self.add_block(count);
        let len = self.pack.out.len() as u64;
        self.index.push(block);
        let is_indexed = self.index.len() >= index::ENTRIES;
        if is_indexed {
            self.add_index(self.length + len);
        }
        let without_piece = self.pack.out.len() as u64;
        let has_rest = count < self.entries.len();
        if has_rest {
            self.add_piece(count, true);
        }
        if let Err(error) = self.sink.put(self.pieces_bytes, &self.pack.out) {
            self.number -= 1;
            self.index.pop();
            return Err(error);
        }
        if is_indexed {
            self.index_at = self.length + len;
            self.index.clear();
        }
        self.length += without_piece;
        self.last_block = (!is_indexed).then_some((len, count as u64));
        self.number -= 1;
        self.written(count);
        self.pieces_bytes = self.pack.out.len() as u64 - without_piece;
        (self.in_pieces, self.pieces) = (self.entries.len(), has_rest.into());
        Ok(())
    }

    /// Forgets the first entries, which the file has as a block.
    fn written(&mut self, count: usize) {
        self.entries.drain(..count);
        (self.number, self.packets) = (self.number + 1, self.packets + count as u64);
        (self.in_pieces, self.pieces) = (0, 0);
    }

    /// Makes the block of the first entries the next write. Returns what an index has of it.
    fn add_block(&mut self, count: usize) -> BlockAt {
        let header = self.header(Kind::Packets, &self.entries[..count]);
        let Packing { blocks, compressor, packed, compressed, out, .. } = &mut self.pack;
        packed.clear();
        blocks.begin(header.times_ns.0);
        blocks.pack(self.entries[..count].iter().map(packet), packed);
        let is_compressed = compressor.compress(packed, compressed);
        out.clear();
        Header { unpacked: packed.len() as u32, is_compressed, ..header }
            .write(if is_compressed { compressed } else { packed }, out);
        let Header { packets, has_orders, times_ns, .. } = header;
        BlockAt { at: self.length, packets, has_orders, is_piece: false, times_ns }
    }

    /// Appends an index of the latest blocks to the next write, which will stand at `at` in the recording.
    fn add_index(&mut self, at: u64) {
        let back = if self.index_at > 0 { at - self.index_at } else { 0 };
        let header = self.header(Kind::Index, &[]);
        let bytes = index::bytes(&self.index, at);
        Header { back, unpacked: bytes.len() as u32, ..header }.write(&bytes, &mut self.pack.out);
    }

    /// Writes the end, and before it with `has_index` the last index. Without, whoever needs one reads the headers of all
    /// blocks.
    fn write_end(&mut self, has_index: bool) -> io::Result<()> {
        let (missing, _) = self.loss.missing();
        let why = (missing > 0).then(|| self.loss.why().to_owned());
        self.pack.out.clear();
        let mut index_at = self.index_at;
        if has_index && !self.index.is_empty() {
            self.add_index(self.length);
            index_at = self.length;
        }
        let length = self.length + self.pack.out.len() as u64;
        let back = if has_index && index_at > 0 { length - index_at } else { 0 };
        let end = End { packets: self.packets, missing, why, length };
        let header = Header { back, ..self.header(Kind::End, &[]) };
        header.write(end.to_text().as_bytes(), &mut self.pack.out);
        self.sink.put(0, &self.pack.out)
    }

    /// Writes the end to a disk that has no room for it and the index: without an index, or else in place of the last block.
    fn write_end_alone(&mut self, error: &io::Error) {
        self.loss.note(error);
        if self.write_end(false).is_ok() {
            return;
        }
        if let Some((len, packets)) = self.last_block
            && self.sink.truncate_by(len).is_ok()
        {
            (self.length, self.packets) = (self.length - len, self.packets - packets);
            self.loss.add(packets);
            // If this fails as well, the missing end shows readers that the recording is incomplete.
            let _ = self.write_end(false);
        }
    }

    /// Stops the recording. On a full disk the entries may still find room as a block, which is shorter than the pieces
    /// that it replaces; if not, as many of them do as there are in the pieces.
    fn fail(&mut self, error: &io::Error) {
        let mut written = self.write_block(0);
        if written.is_err() {
            self.loss.add((self.entries.len() - self.in_pieces) as u64);
            self.entries.truncate(self.in_pieces);
            written = self.write_block(0);
        }
        if written.is_err() {
            self.loss.add(self.entries.len() as u64);
            self.entries.clear();
            let _ = self.sink.truncate_by(std::mem::take(&mut self.pieces_bytes));
            (self.in_pieces, self.pieces) = (0, 0);
        }
        self.loss.fail(error);
    }
}

impl<E: Entry> Writer<E> for BlockWriter<E> {
    fn push(&mut self, entry: E) {
        if self.loss.has_failed() {
            self.loss.add(1);
            return;
        }
        self.last_ns = self.last_ns.max(entry.at_ns());
        self.entries.push(entry);
        if self.entries.len() >= BLOCK + self.held_back()
            && let Err(error) = self.write_block(self.held_back())
        {
            self.fail(&error);
        }
    }

    fn flush(&mut self) {
        if let Err(error) = self.write_piece() {
            self.fail(&error);
        }
    }

    fn end(&mut self) {
        if let Err(error) = self.write_block(0) {
            self.fail(&error);
        }
        if let Err(error) = self.write_end(true) {
            self.write_end_alone(&error);
        }
        self.sink.ended(self.last_ns);
    }

    fn loss(&mut self) -> &mut Loss {
        &mut self.loss
    }
}

fn packet<E: Entry>(entry: &E) -> Packet<'_> {
    Packet { at_ns: entry.at_ns(), dir: entry.dir(), bytes: entry.bytes() }
}
