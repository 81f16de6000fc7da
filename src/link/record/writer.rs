//! The recorder's thread: writes frames of a board, or packets of a chip, to the file. [`Capture`] writes them as
//! pcapng blocks, `blocks.rs` in the format `.ecmrec`.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use pcap_file::pcapng::PcapNgWriter;
use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketBlock;
use pcap_file::pcapng::blocks::interface_description::{InterfaceDescriptionBlock, InterfaceDescriptionOption};
use pcap_file::pcapng::blocks::interface_statistics::{InterfaceStatisticsBlock, InterfaceStatisticsOption};
use pcap_file::pcapng::blocks::section_header::{SectionHeaderBlock, SectionHeaderOption};
use pcap_file::{DataLink, Endianness, PcapError};

use super::file::Sink;
use super::loss::Loss;
use super::queue::Queue;
use crate::link::Dir;
use crate::recording::file_formats::ecmrec::header::What;
use crate::recording::file_formats::usbmon;
use crate::recording::{Clock, RecordMeta};
use crate::sk::{CommandId, FRAME_LEN, Frame, SlotSize};

/// The most bytes of one write to the file. \[OURS]
const BATCH_BYTES: usize = 64 * 1024;

const PACKET_LEN: usize = usbmon::HEADER_LEN + FRAME_LEN;
/// The bytes of a block around its packet: type, length, interface, time in two halves, two lengths of the packet, and the
/// length again.
const AROUND_PACKET: usize = 32;
/// The most frames that fit into one write of [`BATCH_BYTES`].
const BATCH_FRAMES: usize = BATCH_BYTES / (PACKET_LEN + AROUND_PACKET);
/// How many frames at the end of the file can be rewritten to insert a late frame before them. On the real clock the
/// reading thread may be late by a whole queue of reports (`queue=`, 32 by default), during which as many commands are
/// written: 64 frames together. 128 frames are twice that. \[OURS]
pub(super) const SORTED_FRAMES: usize = 128;
/// The most bytes of the blocks that end a section. A recording begins only if the disk has room for them. \[OURS]
pub(super) const SECTION_END_BYTES_MAX: usize = 512;
/// `if_tsresol`: times are in units of 10^-9 s.
const NANOSECONDS: u8 = 9;

/// The content of one block of a recording, queued for the file.
pub(in crate::link) trait Entry: Send + 'static {
    /// The link type of pcapng (LINKTYPE_..., for example Ethernet), which says how a reader decodes the packets.
    const LINK_TYPE: DataLink;
    /// The name of the recorded hardware in the file.
    const HARDWARE: &'static str;
    /// Whether entries may arrive late and are then inserted by their times. This needs blocks that all have the same
    /// length.
    const MAY_COME_LATE: bool;
    /// The largest number of bytes of a packet in pcapng, with its header there (such as that of usbmon).
    const PACKET_MAX: usize;
    /// The kind of the packets as the headers of an `.ecmrec` file have it: of a board, a chip or a network.
    const WHAT: What;

    /// The time stamp in the file, in nanoseconds.
    fn at_ns(&self) -> u64;

    /// The direction: to the board or the chip, or from it.
    fn dir(&self) -> Dir;

    /// Stores the packet in `packet`, which has [`Self::PACKET_MAX`] bytes, and returns its length. `id` counts the
    /// packets of a section from 0.
    fn packet(&self, id: u64, packet: &mut [u8]) -> usize;

    /// The bytes of the frame or packet, without the header that it has in pcapng (such as that of usbmon).
    fn bytes(&self) -> &[u8];

    /// Whether the entry is a command to the board itself (in slot 0) other than GET_STATUS. Such a command changes the
    /// state of the board, so a program that reads only a part of the recording needs the commands before that part.
    fn is_order(&self) -> bool {
        false
    }

    /// The key by which entries are sorted. If a report and a command have the same time the report comes first, since
    /// the command had not reached the board when the report was made.
    fn key(&self) -> (u64, bool) {
        (self.at_ns(), matches!(self.dir(), Dir::Write))
    }
}

/// A frame of a board that is queued for the file.
#[derive(Clone)]
pub(super) struct FrameEntry {
    /// The time stamp in the file, in nanoseconds.
    pub at_ns: u64,
    pub dir: Dir,
    pub frame: Frame,
}

impl Entry for FrameEntry {
    const LINK_TYPE: DataLink = DataLink::USB_LINUX_MMAPPED;
    const HARDWARE: &'static str = "ECM-SK";
    const MAY_COME_LATE: bool = true;
    const PACKET_MAX: usize = PACKET_LEN;
    const WHAT: What = What::Board;

    fn at_ns(&self) -> u64 {
        self.at_ns
    }

    fn dir(&self) -> Dir {
        self.dir
    }

    fn packet(&self, id: u64, packet: &mut [u8]) -> usize {
        packet[..usbmon::HEADER_LEN].copy_from_slice(&usbmon::header(self.dir, id, self.at_ns));
        packet[usbmon::HEADER_LEN..].copy_from_slice(self.frame.bytes());
        PACKET_LEN
    }

    fn bytes(&self) -> &[u8] {
        self.frame.bytes()
    }

    fn is_order(&self) -> bool {
        // The command of slot 0 is at the same place with both slot sizes, so any size serves to read it.
        self.dir == Dir::Write && self.frame.slot(SlotSize::default(), 0).id != CommandId::GetStatus.code()
    }
}

/// A recording that is being written, as pcapng or as `.ecmrec`.
pub(super) trait Writer<E>: Send + 'static {
    /// Adds an entry. It need not be in the file before [`Self::flush`].
    fn push(&mut self, entry: E);

    /// Writes all entries to the file.
    fn flush(&mut self);

    /// Writes the entries that are not in the file yet, and the end of the recording.
    fn end(&mut self);

    /// The counter of frames that the recording lacks, with the reason.
    fn loss(&mut self) -> &mut Loss;
}

/// Writes the frames from the queue until the recording ends, then writes its end.
///
/// All frames in the queue are written without delay, in one write, because the program may crash at any moment and its
/// last frames show why.
pub(super) fn run<E: Entry>(queue: &Queue<E>, mut recording: impl Writer<E>) {
    // When this thread ends, even by a panic, dropping `ends` lets no other thread wait for it any more.
    let ends = Ends(queue);
    while queue.take_all(|entry| recording.push(entry)) {
        recording.flush();
        recording.loss().tell();
    }
    drop(ends);
    recording.end();
    recording.loss().tell_at_end();
}

struct Ends<'a, E>(&'a Queue<E>);

impl<E> Drop for Ends<'_, E> {
    fn drop(&mut self) {
        self.0.end();
    }
}

/// The section of a pcapng file that is being written.
///
/// In a file on the real clock frames are in the order of their times, although a thread of the program may hand one
/// over late: such a frame is inserted by its time, and the frames after it are written again. A pipe gets the frames
/// in the order in which they arrive, and so does a file on a virtual clock, where this is the order of the calls.
pub(super) struct Capture<E> {
    loss: Loss,
    sink: Sink,
    /// Whether frames are inserted in the order of their times.
    sorts: bool,
    /// Blocks that go to the file with the next write.
    blocks: PcapNgWriter<Vec<u8>>,
    /// Frames that have not been written yet.
    waiting: Vec<E>,
    /// The newest frames in the file, for inserting late ones; empty if frames are not sorted.
    recent: VecDeque<E>,
    frames_written: u64,
    /// The length of the last block in the file, bytes.
    last_block: u64,
    /// A buffer for one packet.
    packet: Box<[u8]>,
    /// The latest time stamp of the frames so far, nanoseconds.
    last_ns: u64,
}

impl<E: Entry> Capture<E> {
    /// Writes the headers of the section. Fails if the disk has no room for them and for the end of the section.
    pub fn begin(loss: Loss, sink: Sink, meta: &RecordMeta) -> io::Result<Self> {
        let mut options = vec![
            SectionHeaderOption::Comment(Cow::Owned(meta.to_string())),
            SectionHeaderOption::Hardware(Cow::Borrowed(E::HARDWARE)),
            SectionHeaderOption::UserApplication(Cow::Borrowed(concat!("ecmsk ", env!("CARGO_PKG_VERSION")))),
        ];
        let machine = meta.machine.iter().flat_map(|machine| machine.comments());
        options.extend(machine.map(|comment| SectionHeaderOption::Comment(Cow::Owned(comment))));
        let section = SectionHeaderBlock { endianness: Endianness::Little, options, ..SectionHeaderBlock::default() };
        let room = BATCH_BYTES + (SORTED_FRAMES + 2) * (E::PACKET_MAX + AROUND_PACKET);
        let mut blocks = PcapNgWriter::with_section_header(Vec::with_capacity(room), section).map_err(io_error)?;
        let interface = InterfaceDescriptionBlock {
            linktype: E::LINK_TYPE,
            snaplen: 0,
            options: vec![
                InterfaceDescriptionOption::IfName(Cow::Borrowed("ecmsk")),
                // Without this option, readers would take the times for microseconds.
                InterfaceDescriptionOption::IfTsResol(NANOSECONDS),
            ],
        };
        blocks.write_pcapng_block(interface).map_err(io_error)?;
        let mut capture = Self {
            loss,
            sorts: E::MAY_COME_LATE && meta.clock == Clock::Real && sink.can_rewrite(),
            sink,
            blocks,
            waiting: Vec::with_capacity(BATCH_FRAMES),
            recent: VecDeque::with_capacity(SORTED_FRAMES + BATCH_FRAMES),
            frames_written: 0,
            last_block: 0,
            packet: vec![0; E::PACKET_MAX].into(),
            last_ns: 0,
        };
        let header_len = capture.blocks.get_ref().len();
        capture.put(0)?;
        if capture.sink.can_rewrite() {
            if let Err(error) = capture.sink.put(0, &[0; SECTION_END_BYTES_MAX]) {
                // Without its end the section would look as if the program had been killed, so its headers are removed.
                capture.sink.truncate_by(header_len as u64)?;
                return Err(error);
            }
            capture.sink.truncate_by(SECTION_END_BYTES_MAX as u64)?;
        }
        Ok(capture)
    }

    /// Writes the waiting frames in the order of their times. Frames in the file with later times are written again
    /// after them.
    fn write_out(&mut self) -> io::Result<()> {
        let mut again = 0;
        if self.sorts {
            self.waiting.sort_by_key(E::key);
            if let Some(first) = self.waiting.first().map(E::key) {
                again = self.recent.iter().rev().take_while(|entry| entry.key() > first).count();
            }
        }
        let from = self.recent.len() - again;
        let (mut old, mut new) = (self.recent.range(from..).peekable(), self.waiting.iter().peekable());
        let mut id = self.frames_written - again as u64;
        let mut last_block = self.last_block;
        while let Some(entry) = match (old.peek(), new.peek()) {
            (Some(before), Some(after)) if before.key() <= after.key() => old.next(),
            (Some(_), None) => old.next(),
            (_, _) => new.next(),
        } {
            let len = entry.packet(id, &mut self.packet);
            let block = EnhancedPacketBlock {
                interface_id: 0,
                timestamp: Duration::from_nanos(entry.at_ns()),
                original_len: len as u32,
                data: Cow::Borrowed(&self.packet[..len]),
                options: Vec::new(),
            };
            let before = self.blocks.get_ref().len();
            self.blocks.write_pcapng_block(block).map_err(io_error)?;
            last_block = (self.blocks.get_ref().len() - before) as u64;
            id += 1;
        }
        // The replaced frames are the last ones of the file and have one length ([`Entry::MAY_COME_LATE`]), so their
        // number gives the number of bytes.
        self.put(again * (E::PACKET_MAX + AROUND_PACKET))?;
        self.last_block = last_block;
        self.frames_written += self.waiting.len() as u64;
        if self.sorts {
            self.recent.extend(self.waiting.drain(..));
            self.recent.make_contiguous()[from..].sort_by_key(E::key);
            self.recent.drain(..self.recent.len().saturating_sub(SORTED_FRAMES));
        } else {
            self.waiting.clear();
        }
        Ok(())
    }

    /// Writes the blocks to the file, in place of its last `back` bytes.
    fn put(&mut self, back: usize) -> io::Result<()> {
        let put = self.sink.put(back as u64, self.blocks.get_ref());
        self.blocks.get_mut().clear();
        put
    }

    fn write_end(&mut self) -> io::Result<()> {
        let (dropped, missing) = self.loss.missing();
        let mut options = vec![
            InterfaceStatisticsOption::IsbIfRecv(self.frames_written + dropped),
            InterfaceStatisticsOption::IsbIfDrop(dropped),
        ];
        options.extend(missing.map(|missing| InterfaceStatisticsOption::Comment(Cow::Owned(missing))));
        let statistics = InterfaceStatisticsBlock {
            interface_id: 0,
            // In pcapng the upper 32 bits come first. The crate writes one little-endian number, so the halves are
            // swapped here.
            timestamp: self.last_ns.rotate_left(32),
            options,
        };
        self.blocks.write_pcapng_block(statistics).map_err(io_error)?;
        self.put(0)
    }
}

impl<E: Entry> Writer<E> for Capture<E> {
    fn push(&mut self, entry: E) {
        if self.loss.has_failed() {
            self.loss.add(1);
            return;
        }
        self.last_ns = self.last_ns.max(entry.at_ns());
        self.waiting.push(entry);
        if self.waiting.len() >= BATCH_FRAMES {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if let Err(error) = self.write_out() {
            self.blocks.get_mut().clear();
            self.loss.add(self.waiting.len() as u64);
            self.waiting.clear();
            self.loss.fail(&error);
        }
    }

    /// Writes the remaining frames and the end of the section, an interface statistics block with the numbers of frames and
    /// of missing frames.
    fn end(&mut self) {
        self.flush();
        if let Err(error) = self.write_end() {
            // If the disk is full there may be no room for the end of the section. The last frame is removed to make room.
            let has_room = self.frames_written > 0 && self.sink.truncate_by(self.last_block).is_ok();
            if has_room {
                self.frames_written -= 1;
                self.loss.add(1);
                self.loss.note(&error);
                // If this fails as well, the missing end shows readers that the recording is incomplete.
                let _ = self.write_end();
            }
        }
        self.sink.ended(self.last_ns);
    }

    fn loss(&mut self) -> &mut Loss {
        &mut self.loss
    }
}

fn io_error(error: PcapError) -> io::Error {
    match error {
        PcapError::IoError(error) => error,
        other => io::Error::other(other),
    }
}
