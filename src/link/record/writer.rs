//! The thread that puts frames on disk, as pcapng.

use std::borrow::Cow;
use std::io::{self, Write};
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

use super::meta::RecordMeta;
use super::usbmon;
use crate::link::Dir;
use crate::sk::{FRAME_LEN, Frame};

/// Bytes that go to the disk in one write. \[OURS]
const BATCH: usize = 64 * 1024;

const PACKET_LEN: usize = usbmon::HEADER_LEN + FRAME_LEN;
/// `if_tsresol`: times are in units of 10^-9 s.
const NANOSECONDS: u8 = 9;

/// A frame on its way to the file.
pub(super) struct Entry {
    /// Time in the file, nanoseconds.
    pub at_ns: u64,
    pub dir: Dir,
    pub frame: Frame,
}

/// Takes frames until every sender is gone, then ends the file.
///
/// What has come goes to the disk at once, in one write: a program may crash at any moment, and its last frames are the
/// interesting ones.
pub(super) fn run(entries: &Receiver<Entry>, mut capture: Capture) {
    while let Ok(entry) = entries.recv() {
        capture.push(&entry);
        while let Ok(entry) = entries.try_recv() {
            capture.push(&entry);
        }
        capture.flush();
    }
    capture.end();
}

/// A section of a pcapng file that grows.
pub(super) struct Capture {
    /// For messages.
    name: String,
    sink: Box<dyn Write + Send>,
    /// Blocks that wait for the disk.
    blocks: PcapNgWriter<Vec<u8>>,
    frames_waiting: u64,
    frames_written: u64,
    last_ns: u64,
    /// Frames that are not in the file, counted by the host's threads too.
    dropped: Arc<AtomicU64>,
    /// The disk is full or gone: nothing more is written, all is counted.
    failed: bool,
}

impl Capture {
    /// Writes the headers.
    pub fn begin(
        name: String,
        sink: Box<dyn Write + Send>,
        meta: &RecordMeta,
        dropped: Arc<AtomicU64>,
    ) -> io::Result<Self> {
        let section = SectionHeaderBlock {
            endianness: Endianness::Little,
            options: vec![
                SectionHeaderOption::Comment(Cow::Owned(meta.to_string())),
                SectionHeaderOption::Hardware(Cow::Borrowed("ECM-SK")),
                SectionHeaderOption::UserApplication(Cow::Borrowed(concat!("ecmsk ", env!("CARGO_PKG_VERSION")))),
            ],
            ..SectionHeaderBlock::default()
        };
        let mut blocks =
            PcapNgWriter::with_section_header(Vec::with_capacity(BATCH + 2 * PACKET_LEN), section).map_err(io_error)?;
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
        let mut capture =
            Self { name, sink, blocks, frames_waiting: 0, frames_written: 0, last_ns: 0, dropped, failed: false };
        capture.write_out()?;
        Ok(capture)
    }

    fn push(&mut self, entry: &Entry) {
        if self.failed {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let id = self.frames_written + self.frames_waiting;
        let mut packet = [0; PACKET_LEN];
        packet[..usbmon::HEADER_LEN].copy_from_slice(&usbmon::header(entry.dir, id, entry.at_ns));
        packet[usbmon::HEADER_LEN..].copy_from_slice(entry.frame.bytes());
        let block = EnhancedPacketBlock {
            interface_id: 0,
            timestamp: Duration::from_nanos(entry.at_ns),
            original_len: PACKET_LEN as u32,
            data: Cow::Borrowed(&packet),
            options: Vec::new(),
        };
        self.frames_waiting += 1;
        self.last_ns = self.last_ns.max(entry.at_ns);
        if let Err(error) = self.blocks.write_pcapng_block(block) {
            self.fail(&io_error(error));
        } else if self.blocks.get_ref().len() >= BATCH {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if let Err(error) = self.write_out() {
            self.fail(&error);
        }
    }

    fn write_out(&mut self) -> io::Result<()> {
        self.sink.write_all(self.blocks.get_ref())?;
        self.sink.flush()?;
        self.blocks.get_mut().clear();
        self.frames_written += std::mem::take(&mut self.frames_waiting);
        Ok(())
    }

    fn fail(&mut self, error: &io::Error) {
        self.failed = true;
        self.blocks.get_mut().clear();
        self.dropped.fetch_add(std::mem::take(&mut self.frames_waiting), Ordering::Relaxed);
        log::warn!("recording to {} has stopped: {error}; frames from here on are counted only", self.name);
    }

    /// Writes what is left and, in the place pcapng has for it, how many frames there were and how many are missing.
    fn end(&mut self) {
        self.flush();
        if self.failed {
            return;
        }
        let dropped = self.dropped.load(Ordering::Relaxed);
        let mut options = vec![
            InterfaceStatisticsOption::IsbIfRecv(self.frames_written + dropped),
            InterfaceStatisticsOption::IsbIfDrop(dropped),
        ];
        if dropped > 0 {
            let comment = format!("{dropped} frames are missing: the disk was too slow");
            log::warn!("recording to {}: {comment}", self.name);
            options.push(InterfaceStatisticsOption::Comment(Cow::Owned(comment)));
        }
        let statistics = InterfaceStatisticsBlock {
            interface_id: 0,
            // pcapng wants the upper half first; the crate writes one little-endian number.
            timestamp: self.last_ns.rotate_left(32),
            options,
        };
        match self.blocks.write_pcapng_block(statistics) {
            Ok(_) => self.flush(),
            Err(error) => self.fail(&io_error(error)),
        }
    }
}

fn io_error(error: PcapError) -> io::Error {
    match error {
        PcapError::IoError(error) => error,
        other => io::Error::other(other),
    }
}
