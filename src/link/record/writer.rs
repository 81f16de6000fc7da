//! The thread that puts frames on disk, as pcapng.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use pcap_file::pcapng::PcapNgWriter;
use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketBlock;
use pcap_file::pcapng::blocks::interface_description::{InterfaceDescriptionBlock, InterfaceDescriptionOption};
use pcap_file::pcapng::blocks::interface_statistics::{InterfaceStatisticsBlock, InterfaceStatisticsOption};
use pcap_file::pcapng::blocks::section_header::{SectionHeaderBlock, SectionHeaderOption};
use pcap_file::{DataLink, Endianness, PcapError};

use super::file::Sink;
use super::tell::tell;
use crate::link::Dir;
use crate::recording::formats::usbmon;
use crate::recording::{Clock, RecordMeta};
use crate::sk::{FRAME_LEN, Frame};

/// Bytes that go to the disk in one write. \[OURS]
const BATCH: usize = 64 * 1024;

const PACKET_LEN: usize = usbmon::HEADER_LEN + FRAME_LEN;
/// Bytes of a frame's block: type, length, interface, time in two halves, two lengths of the packet, and the length again.
const BLOCK_LEN: usize = PACKET_LEN + 32;
/// Frames of a batch.
const BATCH_FRAMES: usize = BATCH / BLOCK_LEN;
/// Frames in the file that are put behind one that comes late: on the real clock a thread that reads may be late by a report
/// queue, each report with a command. \[OURS]
const SORTED: usize = 128;
/// What a section's end may need, so that there is room for it from the beginning. \[OURS]
const END_ROOM: usize = 512;
/// `if_tsresol`: times are in units of 10^-9 s.
const NANOSECONDS: u8 = 9;

/// Why frames are missing where nothing has failed.
const TOO_SLOW: &str = "the disk was too slow";

/// A frame on its way to the file.
pub(super) struct Entry {
    /// Time in the file, nanoseconds.
    pub at_ns: u64,
    pub dir: Dir,
    pub frame: Frame,
}

impl Entry {
    /// The order of time. A command of the same moment had not reached the board when a report was made.
    const fn key(&self) -> (u64, bool) {
        (self.at_ns, matches!(self.dir, Dir::Write))
    }
}

/// Takes frames until every sender is gone, then ends the file.
///
/// What has come goes to the disk at once, in one write: a program may crash at any moment, and its last frames are the
/// interesting ones.
pub(super) fn run(entries: &Receiver<Entry>, mut capture: Capture) {
    while let Ok(entry) = entries.recv() {
        capture.push(entry);
        while let Ok(entry) = entries.try_recv() {
            capture.push(entry);
        }
        capture.flush();
        capture.tell_lost();
    }
    capture.end();
}

/// A section of a pcapng file that grows.
///
/// On the real clock frames stand in it in the order of their times, however late the thread of the program that moved one
/// has got on: a frame that comes late is put in its place, and those behind it are written again. Nothing is held back
/// for that. A pipe has them in the order in which they came, and on a virtual clock that is the order of the calls.
pub(super) struct Capture {
    /// For messages.
    name: String,
    sink: Sink,
    sorts: bool,
    /// Blocks on their way to the disk.
    blocks: PcapNgWriter<Vec<u8>>,
    /// Frames that wait for the disk.
    waiting: Vec<Entry>,
    /// The newest frames in the file, if it is sorted.
    recent: VecDeque<Entry>,
    frames_written: u64,
    last_ns: u64,
    /// Frames that are not in the file, counted by the host's threads too.
    dropped: Arc<AtomicU64>,
    /// Somebody was told that frames are lost.
    told: bool,
    /// The disk is full or gone, and why: nothing more is written, all is counted.
    failed: Option<String>,
}

impl Capture {
    /// Writes the headers. A file that has room for them and not for an end is full already.
    pub fn begin(name: String, sink: Sink, meta: &RecordMeta, dropped: Arc<AtomicU64>) -> io::Result<Self> {
        let section = SectionHeaderBlock {
            endianness: Endianness::Little,
            options: vec![
                SectionHeaderOption::Comment(Cow::Owned(meta.to_string())),
                SectionHeaderOption::Hardware(Cow::Borrowed("ECM-SK")),
                SectionHeaderOption::UserApplication(Cow::Borrowed(concat!("ecmsk ", env!("CARGO_PKG_VERSION")))),
            ],
            ..SectionHeaderBlock::default()
        };
        let room = BATCH + (SORTED + 2) * BLOCK_LEN;
        let mut blocks = PcapNgWriter::with_section_header(Vec::with_capacity(room), section).map_err(io_error)?;
        let interface = InterfaceDescriptionBlock {
            linktype: DataLink::USB_LINUX_MMAPPED,
            snaplen: 0,
            options: vec![
                InterfaceDescriptionOption::IfName(Cow::Borrowed("ecmsk")),
                // Without it, readers take the times for microseconds.
                InterfaceDescriptionOption::IfTsResol(NANOSECONDS),
            ],
        };
        blocks.write_pcapng_block(interface).map_err(io_error)?;
        let mut capture = Self {
            name,
            sorts: meta.clock == Clock::Real && sink.can_go_back(),
            sink,
            blocks,
            waiting: Vec::with_capacity(BATCH_FRAMES),
            recent: VecDeque::with_capacity(SORTED + BATCH_FRAMES),
            frames_written: 0,
            last_ns: 0,
            dropped,
            told: false,
            failed: None,
        };
        let header_len = capture.blocks.get_ref().len();
        capture.put(0)?;
        if capture.sink.can_go_back() {
            if let Err(error) = capture.sink.put(0, &[0; END_ROOM]) {
                // Without an end it would look as if its program had been killed.
                capture.sink.take_back(header_len as u64)?;
                return Err(error);
            }
            capture.sink.take_back(END_ROOM as u64)?;
        }
        Ok(capture)
    }

    fn push(&mut self, entry: Entry) {
        if self.failed.is_some() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        self.last_ns = self.last_ns.max(entry.at_ns);
        self.waiting.push(entry);
        if self.waiting.len() >= BATCH_FRAMES {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if let Err(error) = self.write_out() {
            self.fail(&error);
        }
    }

    /// Writes what waits, and once more those frames that belong behind it.
    fn write_out(&mut self) -> io::Result<()> {
        let mut again = 0;
        if self.sorts {
            self.waiting.sort_by_key(Entry::key);
            if let Some(first) = self.waiting.first().map(Entry::key) {
                again = self.recent.iter().rev().take_while(|entry| entry.key() > first).count();
            }
        }
        let from = self.recent.len() - again;
        let (mut old, mut new) = (self.recent.range(from..).peekable(), self.waiting.iter().peekable());
        let mut id = self.frames_written - again as u64;
        while let Some(entry) = match (old.peek(), new.peek()) {
            (Some(before), Some(after)) if before.key() <= after.key() => old.next(),
            (Some(_), None) => old.next(),
            (_, _) => new.next(),
        } {
            self.blocks.write_pcapng_block(packet(entry, id, &mut [0; PACKET_LEN])).map_err(io_error)?;
            id += 1;
        }
        self.put(again * BLOCK_LEN)?;
        self.frames_written += self.waiting.len() as u64;
        if self.sorts {
            self.recent.extend(self.waiting.drain(..));
            self.recent.make_contiguous()[from..].sort_by_key(Entry::key);
            self.recent.drain(..self.recent.len().saturating_sub(SORTED));
        } else {
            self.waiting.clear();
        }
        Ok(())
    }

    /// Brings the blocks to the file, in the place of its last `back` bytes.
    fn put(&mut self, back: usize) -> io::Result<()> {
        let put = self.sink.put(back as u64, self.blocks.get_ref());
        self.blocks.get_mut().clear();
        put
    }

    fn fail(&mut self, error: &io::Error) {
        self.blocks.get_mut().clear();
        self.dropped.fetch_add(self.waiting.len() as u64, Ordering::Relaxed);
        self.waiting.clear();
        self.failed = Some(error.to_string());
        self.told = true;
        tell(format!("recording to {} has stopped: {error}; frames from here on are counted only", self.name));
    }

    /// The first frames that were lost are told at once, and by this thread: it was not the disk alone that had no time.
    fn tell_lost(&mut self) {
        if !self.told && self.dropped.load(Ordering::Relaxed) > 0 {
            self.told = true;
            tell(format!("recording to {}: frames are missing: {TOO_SLOW}; record to a faster disk", self.name));
        }
    }

    /// Writes what is left and, in the place pcapng has for it, how many frames there were and how many are missing.
    fn end(&mut self) {
        self.flush();
        if let Err(error) = self.write_end() {
            // A disk that is full has no room for it: the last frame makes some.
            let gave_room = self.frames_written > 0 && self.sink.take_back(BLOCK_LEN as u64).is_ok();
            if gave_room {
                self.frames_written -= 1;
                self.dropped.fetch_add(1, Ordering::Relaxed);
                self.failed.get_or_insert_with(|| error.to_string());
                // A recording without an end says by that that it lacks something.
                let _ = self.write_end();
            }
        }
        self.sink.ended(self.last_ns);
        let dropped = self.dropped.load(Ordering::Relaxed);
        if dropped > 0 {
            let why = self.failed.as_deref().unwrap_or(TOO_SLOW);
            tell(format!("recording to {}: {dropped} frames are missing: {why}", self.name));
        }
    }

    fn write_end(&mut self) -> io::Result<()> {
        let dropped = self.dropped.load(Ordering::Relaxed);
        let mut options = vec![
            InterfaceStatisticsOption::IsbIfRecv(self.frames_written + dropped),
            InterfaceStatisticsOption::IsbIfDrop(dropped),
        ];
        if dropped > 0 {
            let why = self.failed.as_deref().unwrap_or(TOO_SLOW);
            options
                .push(InterfaceStatisticsOption::Comment(Cow::Owned(format!("{dropped} frames are missing: {why}"))));
        }
        let statistics = InterfaceStatisticsBlock {
            interface_id: 0,
            // pcapng wants the upper half first; the crate writes one little-endian number.
            timestamp: self.last_ns.rotate_left(32),
            options,
        };
        self.blocks.write_pcapng_block(statistics).map_err(io_error)?;
        self.put(0)
    }
}

/// The block of a frame.
fn packet<'a>(entry: &Entry, id: u64, packet: &'a mut [u8; PACKET_LEN]) -> EnhancedPacketBlock<'a> {
    packet[..usbmon::HEADER_LEN].copy_from_slice(&usbmon::header(entry.dir, id, entry.at_ns));
    packet[usbmon::HEADER_LEN..].copy_from_slice(entry.frame.bytes());
    EnhancedPacketBlock {
        interface_id: 0,
        timestamp: Duration::from_nanos(entry.at_ns),
        original_len: PACKET_LEN as u32,
        data: Cow::Borrowed(&packet[..]),
        options: Vec::new(),
    }
}

fn io_error(error: PcapError) -> io::Error {
    match error {
        PcapError::IoError(error) => error,
        other => io::Error::other(other),
    }
}
