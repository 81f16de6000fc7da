//! Reads recordings back, and captures of a real board that Wireshark or tcpdump made by Linux' usbmon.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::container::{Blocks, Item, Packet};
use super::meta::RecordMeta;
use super::usbmon;
use crate::link::Dir;
use crate::sk::{FRAME_LEN, Frame, SlotSize};

/// Bytes of a frame behind a report id, as some hosts capture it.
const WITH_REPORT_ID: usize = 1 + FRAME_LEN;
/// Bytes of a frame without filler.
const NARROW: usize = SlotSize::Bytes12.frame_len();

/// A frame in a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// When it passed, nanoseconds: of the link's clock plus [`RecordMeta::base_ns`]; in a capture of a real board
    /// since 1970-01-01.
    pub at_ns: u64,
    /// To the board or from it.
    pub dir: Dir,
    /// All its bytes; what a capture does not have is 0.
    pub frame: Frame,
    /// The bus of a real board, as the system numbered it.
    pub bus: u16,
    /// The board on that bus; it changes when the board is plugged again.
    pub device: u8,
}

/// Why a recording cannot be read, or not further.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecordError {
    /// The operating system said no.
    #[error("{name}: {message}; check the path and who may read it")]
    Io {
        /// The file.
        name: String,
        /// The system's words.
        message: String,
    },
    /// It begins like no capture.
    #[error("{name} is neither a pcapng nor a pcap file; make one with the link key record= or with Wireshark")]
    NotACapture {
        /// The file.
        name: String,
    },
    /// It ends inside a block.
    #[error(
        "{name} ends in the middle of the block at byte {offset}; the frames before it are whole; close the link before copying its recording"
    )]
    Truncated {
        /// The file.
        name: String,
        /// Where the block begins.
        offset: u64,
    },
    /// A block that cannot be.
    #[error("{name} is damaged at byte {offset}: {reason}; the frames before it are whole; record again")]
    Malformed {
        /// The file.
        name: String,
        /// Where the block begins.
        offset: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// No packet in it can be one of a board.
    #[error(
        "{name} holds no USB traffic of Linux (link type 220 or 189) but {found}; record with record= or capture usbmon"
    )]
    NoUsb {
        /// The file.
        name: String,
        /// The link types it has.
        found: String,
    },
    /// A packet holds less than the frame that passed.
    #[error(
        "{name}: the frame at byte {offset} was captured to {captured} of {length} bytes; capture whole packets (snap length 0)"
    )]
    Cut {
        /// The file.
        name: String,
        /// Where the block begins.
        offset: u64,
        /// Bytes there are.
        captured: usize,
        /// Bytes that passed.
        length: u32,
    },
}

/// The frames of a recording or a capture, in the order of the file.
///
/// Of other traffic in a capture nothing is seen: a frame is an interrupt transfer of 512 or 504 bytes, or of 513 with a
/// report id. After an error there is nothing more.
pub struct Recording<R> {
    blocks: Blocks<R>,
    name: String,
    meta: Option<RecordMeta>,
    missing: u64,
    /// Link types of interfaces that are no USB, for an error; `None` once there was one that is.
    others: Option<Vec<String>>,
    ended: bool,
}

impl Recording<File> {
    /// Opens a file.
    ///
    /// # Errors
    /// [`RecordError`] if it cannot be read or is no capture.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let name = path.display().to_string();
        match File::open(path) {
            Ok(file) => Self::new(file, &name),
            Err(error) => Err(RecordError::Io { name, message: error.to_string() }),
        }
    }
}

impl<R: Read> Recording<R> {
    /// Reads from any source; `name` is for messages.
    ///
    /// # Errors
    /// [`RecordError`] if it does not begin like a capture.
    pub fn new(source: R, name: &str) -> Result<Self, RecordError> {
        let mut recording = Self {
            blocks: Blocks::new(source, name.to_owned()),
            name: name.to_owned(),
            meta: None,
            missing: 0,
            others: Some(Vec::new()),
            ended: false,
        };
        // The file's header, so that `meta` is known at once.
        recording.step()?;
        Ok(recording)
    }

    /// What the recording says of itself; `None` for a capture that somebody else made. A file that was recorded to
    /// more than once has several: this is the one of the frame read last.
    pub const fn meta(&self) -> Option<&RecordMeta> {
        self.meta.as_ref()
    }

    /// Frames that are known to be missing, as far as it was read: a recording tells at its end.
    pub const fn missing(&self) -> u64 {
        self.missing
    }

    /// One block on: a frame if it holds one; `None` at the end.
    fn step(&mut self) -> Result<Option<Option<Recorded>>, RecordError> {
        let Some(item) = self.blocks.next()? else { return Ok(None) };
        match item {
            Item::Section(meta) => self.meta = meta,
            Item::Interface(link_type) if usbmon::is_usbmon(link_type) => self.others = None,
            Item::Interface(link_type) => {
                if let Some(others) = &mut self.others {
                    others.push(format!("{link_type:?}"));
                }
            }
            Item::Packet(packet) => return frame(&self.name, &packet).map(Some),
            Item::Missing(frames) => self.missing = self.missing.saturating_add(frames),
            Item::Other => {}
        }
        Ok(Some(None))
    }

    fn next_frame(&mut self) -> Result<Option<Recorded>, RecordError> {
        while let Some(step) = self.step()? {
            if step.is_some() {
                return Ok(step);
            }
        }
        match self.others.take() {
            None => Ok(None),
            Some(found) if found.is_empty() => {
                Err(RecordError::NoUsb { name: self.name.clone(), found: "no interface".to_owned() })
            }
            Some(found) => Err(RecordError::NoUsb { name: self.name.clone(), found: found.join(", ") }),
        }
    }
}

impl<R: Read> Iterator for Recording<R> {
    type Item = Result<Recorded, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let frame = self.next_frame().transpose();
        self.ended = !matches!(frame, Some(Ok(_)));
        frame
    }
}

/// The frame in a packet, if it holds one.
fn frame(name: &str, packet: &Packet<'_>) -> Result<Option<Recorded>, RecordError> {
    let Some(transfer) = usbmon::transfer(packet.link_type, packet.order, packet.data) else { return Ok(None) };
    let length = transfer.length as usize;
    if ![FRAME_LEN, NARROW, WITH_REPORT_ID].contains(&length) {
        return Ok(None);
    }
    let Some(data) = transfer.data.get(..length) else {
        let (offset, captured) = (packet.offset, transfer.data.len());
        return Err(RecordError::Cut { name: name.to_owned(), offset, captured, length: transfer.length });
    };
    let data = if length == WITH_REPORT_ID { &data[1..] } else { data };
    let frame = Frame::from_prefix(data);
    Ok(Some(Recorded { at_ns: packet.at_ns, dir: transfer.dir, frame, bus: transfer.bus, device: transfer.device }))
}
