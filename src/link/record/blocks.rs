//! Writes a recording as `.ecmrec`, the format for recordings that last for weeks
//! ([`ecmrec`](crate::recording::file_formats::ecmrec)).
//!
//! An entry is a frame of a board or a network, or a packet of a chip. New entries go to the end of the file at once,
//! as a piece: stored as differences from the entries before, but not compressed. Once there are [`BLOCK`] entries, a
//! compressed block replaces their pieces. So a program that is killed leaves all but its last milliseconds in the
//! file, and the file is small all the same. What was written to a pipe cannot be replaced, so there the pieces stay.

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

/// What a [`BlockWriter`] does with entries that are not in a block yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pieces {
    /// Entries go to the file at once as pieces, and later a block replaces the pieces. Only a file on a disk allows
    /// that.
    Replaced,
    /// Entries go to the file at once as pieces, which stay there. No blocks are written, so that written bytes never
    /// change.
    Kept,
    /// Entries wait in memory for their block, so that written bytes never change.
    None,
}

/// Writes a recording as `.ecmrec`, block by block.
pub(super) struct BlockWriter<E> {
    loss: Loss,
    sink: Sink,
    form: Pieces,
    /// Whether a block has its entries in the order of their times. Entries are sorted if they may come late, unless
    /// they are final in the file before their block ([`Pieces::Kept`]).
    sorts: bool,
    /// The entries that are not in a block yet. If entries are sorted, the newest ones stay here for the next block,
    /// because an entry that comes late may belong before them.
    entries: Vec<E>,
    /// The number of entries at the beginning of `entries` that repeat earlier ones ([`Section::repeated`]). Sorting
    /// leaves them at the beginning.
    repeated: usize,
    /// How many of `entries` are in the file already, as pieces.
    in_pieces: usize,
    /// The number of pieces after the last block, and the length that they take at the end of the file, bytes.
    pieces: u32,
    pieces_bytes: u64,
    /// The number of blocks so far, and of the entries in them.
    number: u32,
    packets: u64,
    /// The length of the recording without the pieces at its end, bytes.
    length: u64,
    /// The length of the last block in bytes and the number of its entries; `None` if an index follows the block. The
    /// block is removed if a full disk has no room for the end of the recording.
    last_block: Option<(u64, u64)>,
    /// The blocks that are not listed in an index of the file yet.
    index: Vec<BlockAt>,
    /// The offset of the last index in the recording; 0 if there is none.
    index_at: u64,
    /// The latest time stamp of the entries so far, nanoseconds.
    last_ns: u64,
    pack: Packing,
}

/// Stores entries as differences and compresses them, in buffers that are used again.
struct Packing {
    /// Packs blocks, each of which can be read alone. `pieces` packs pieces, each of which continues the piece before
    /// it.
    blocks: Packer,
    pieces: Packer,
    compressor: Compressor,
    packed: Vec<u8>,
    compressed: Vec<u8>,
    /// The bytes of the next write to the file.
    out: Vec<u8>,
}

impl<E: Entry> BlockWriter<E> {
    /// Writes the beginning of the recording. Fails if the disk has no room for the beginning and the end of a
    /// recording.
    pub fn begin(loss: Loss, sink: Sink, meta: &RecordMeta) -> io::Result<Self> {
        let form = if sink.can_rewrite() { Pieces::Replaced } else { Pieces::Kept };
        Self::begin_as(form, loss, sink, &Section { meta: Some(meta.clone()), repeated: 0 }, meta.clock)
    }

    /// As [`Self::begin`]. `form` says how entries are treated that are not in a block yet; `section` is the contents
    /// of the first block.
    pub fn begin_as(form: Pieces, loss: Loss, sink: Sink, section: &Section, clock: Clock) -> io::Result<Self> {
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
            sorts: E::MAY_COME_LATE && clock == Clock::Real && form != Pieces::Kept,
            sink,
            form,
            entries: Vec::with_capacity(BLOCK + SORTED_FRAMES),
            repeated: section.repeated as usize,
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
        let header = Header { kind: Some(Kind::Section), what: E::WHAT, ..Header::default() };
        header.write(section.to_text().as_bytes(), &mut writer.pack.out);
        let length = writer.pack.out.len() as u64;
        writer.sink.put(0, &writer.pack.out)?;
        if writer.sink.can_rewrite() {
            if let Err(error) = writer.sink.put(0, &[0; SECTION_END_BYTES_MAX]) {
                // Without room for its end the recording would look as if the program had been killed, so the beginning
                // is removed.
                writer.sink.truncate_by(length)?;
                return Err(error);
            }
            writer.sink.truncate_by(SECTION_END_BYTES_MAX as u64)?;
        }
        writer.length = length;
        Ok(writer)
    }

    /// The number of newest entries that are left for the next block when a block is written.
    const fn held_back(&self) -> usize {
        if self.sorts { SORTED_FRAMES } else { 0 }
    }

    /// Writes the entries that are not in the file yet as a piece, in the order in which they came.
    fn write_piece(&mut self) -> io::Result<()> {
        if self.in_pieces == self.entries.len() || self.form == Pieces::None {
            return Ok(());
        }
        self.pack.out.clear();
        self.add_piece(self.in_pieces, self.in_pieces == 0);
        self.sink.put(0, &self.pack.out)?;
        let len = self.pack.out.len() as u64;
        if self.form == Pieces::Replaced {
            self.pieces_bytes += len;
        } else {
            self.length += len;
        }
        self.pieces += 1;
        self.in_pieces = self.entries.len();
        Ok(())
    }

    /// Appends a piece with the entries from the index `from` on to the buffer of the next write. `is_first`: it is the
    /// first piece after a block; otherwise it continues the piece before.
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

    /// Replaces the pieces by a block. `held_back` of the newest entries become the first piece of the next block.
    /// Fails if the disk does not also have room for `room` more bytes. After an error all entries are still in memory,
    /// and the pieces in the file may be damaged.
    fn write_block(&mut self, held_back: usize, room: usize) -> io::Result<()> {
        let count = self.entries.len().saturating_sub(held_back);
        if count == 0 {
            return Ok(());
        }
        if self.form == Pieces::Kept {
            self.write_piece()?;
            self.written(count);
            return Ok(());
        }
        if self.sorts
            && let Some(entries) = self.entries.get_mut(self.repeated..)
            && !entries.is_sorted_by_key(E::key)
        {
            entries.sort_by_key(E::key);
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
        let has_piece = self.form == Pieces::Replaced && count < self.entries.len();
        if has_piece {
            self.add_piece(count, true);
        }
        let room = if self.sink.can_rewrite() { room } else { 0 };
        let end = self.pack.out.len();
        self.pack.out.resize(end + room, 0);
        let mut put = self.sink.put(self.pieces_bytes, &self.pack.out);
        self.pack.out.truncate(end);
        if room > 0 && put.is_ok() {
            put = self.sink.truncate_by(room as u64);
        }
        if let Err(error) = put {
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
        if has_piece {
            (self.in_pieces, self.pieces) = (self.entries.len(), 1);
        }
        Ok(())
    }

    /// Removes the first `count` entries from memory, because the file has them.
    fn written(&mut self, count: usize) {
        self.entries.drain(..count);
        self.repeated = self.repeated.saturating_sub(count);
        (self.number, self.packets) = (self.number + 1, self.packets + count as u64);
        (self.in_pieces, self.pieces) = (0, 0);
    }

    /// Begins the next write with a block of the first `count` entries. Returns the entry for this block in an index.
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

    /// Appends an index of the blocks since the last index to the next write. `at` is the offset of the index in the
    /// recording.
    fn add_index(&mut self, at: u64) {
        let back = if self.index_at > 0 { at - self.index_at } else { 0 };
        let header = self.header(Kind::Index, &[]);
        let bytes = index::bytes(&self.index, at);
        Header { back, unpacked: bytes.len() as u32, ..header }.write(&bytes, &mut self.pack.out);
    }

    /// Writes the end of the recording, with `has_index` also an index before it. If there is no index, readers of the
    /// file read the headers of all blocks instead.
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

    /// Writes the end of the recording to a disk that has no room for an index and the end. First it leaves out the
    /// index. If that fails as well it removes the last block and writes the end in its place.
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

    /// Writes a block of all entries. The recording may go on after it.
    pub(super) fn write_all_blocks(&mut self) {
        if let Err(error) = self.write_block(0, SECTION_END_BYTES_MAX) {
            self.fail(&error);
        }
    }

    /// Stops the recording after an error. On a full disk a block of all entries may still fit, since it is shorter
    /// than the pieces that it replaces. Otherwise entries are dropped, first those that are not in the file yet, and a
    /// block is tried with fewer and fewer entries: it has to leave room for the end of the recording. If not even one
    /// entry fits, the pieces are removed.
    fn fail(&mut self, error: &io::Error) {
        let fewer = |entries: usize| entries - entries.div_ceil(64);
        let mut kept = if self.in_pieces > 0 { self.in_pieces } else { fewer(self.entries.len()) };
        while self.write_block(0, SECTION_END_BYTES_MAX).is_err() {
            self.loss.add((self.entries.len() - kept) as u64);
            self.entries.truncate(kept);
            if kept == 0 {
                let _ = self.sink.truncate_by(std::mem::take(&mut self.pieces_bytes));
                (self.in_pieces, self.pieces) = (0, 0);
                break;
            }
            kept = fewer(kept);
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
            && let Err(error) = self.write_block(self.held_back(), 0)
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
        self.write_all_blocks();
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

#[cfg(all(test, unix))]
mod tests {
    use std::path::Path;
    use std::process::Command;
    use std::sync::Arc;

    use super::*;
    use crate::link::record::file;
    use crate::link::record::writer::FrameEntry;
    use crate::link::{Dir, Stamp};
    use crate::recording::Recording;
    use crate::sk::Frame;

    const TEST: &str = "link::record::blocks::tests::a_disk_that_is_full_keeps_what_was_in_pieces";
    const PATH: &str = "ECMSK_TEST_FULL_BLOCKS";
    /// The number of entries in a piece that nearly fills the disk, and of the entries that come later.
    const IN_PIECES: u64 = 500;
    const LATER: u64 = 1000;

    /// Records frames that cannot be compressed and for which the disk has no room. The link in the recording's
    /// metadata is the path, twice.
    fn record(path: &Path) {
        let file = Sink::File(file::open(path).unwrap());
        let loss = Loss::new("a file".to_owned(), Arc::default());
        let meta = RecordMeta::begun(path.display().to_string().repeat(2), None, true, Stamp(0));
        let mut writer = BlockWriter::begin(loss, file, &meta).unwrap();
        let mut random = 1_u64;
        for number in 0..IN_PIECES + LATER {
            let mut frame = Frame::new();
            for byte in frame.bytes_mut() {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                *byte = (random >> 56) as u8;
            }
            writer.push(FrameEntry { at_ns: number * 1000, dir: Dir::Write, frame });
            if number == IN_PIECES - 1 {
                writer.flush();
            }
        }
        writer.end();
    }

    /// If the disk has no room for a block, the entries that are in the file as pieces stay there.
    #[test]
    fn a_disk_that_is_full_keeps_what_was_in_pieces() {
        if let Some(path) = crate::address::config::variable(PATH) {
            return record(path.as_ref());
        }
        let folder = tempfile::tempdir().unwrap();
        // Limits of the file in units of 512 bytes. At 562 the piece fits. Whether the end of the recording fits after
        // it depends on the length of the name.
        for (limit, name) in
            [240, 561, 562, 563].into_iter().flat_map(|limit| (1..240).step_by(30).map(move |name| (limit, name)))
        {
            let path = folder.path().join(format!("{limit}{}.ecmrec", "x".repeat(name)));
            let limited = "trap '' XFSZ; ulimit -f \"$1\"; exec \"$0\" --exact --nocapture \"$2\"";
            let mut child = Command::new("sh");
            child.args(["-c", limited]).arg(std::env::current_exe().unwrap());
            let child = child.args([&limit.to_string(), TEST]).env(PATH, &path).output().unwrap();
            assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stderr));
            let mut recording = Recording::open(&path).unwrap();
            let found = recording.by_ref().filter(Result::is_ok).count() as u64;
            let lacks = recording.lacks();
            assert_eq!((lacks.not_ended, lacks.damage.count), (0, 0), "{limit}: {lacks}");
            assert_eq!(found + lacks.missing, IN_PIECES + LATER, "{limit}: {lacks}");
            let fits = IN_PIECES.min(limit * 512 / 600) * 63 / 64;
            assert!(found >= fits, "{limit}, {name}: {found} of {fits}, {lacks}");
        }
    }
}
