//! Reads recordings, and captures of a real board that Wireshark or tcpdump made by Linux' usbmon, or by USBPcap on
//! Windows.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use pcap_file::DataLink;

use super::address::Address;
use super::devices::{self, CapturedDevice, Cut, Devices, Skipped};
use super::error::RecordError;
use super::file_formats;
use super::file_formats::container::{Blocks, Item};
use super::lacks::Lacks;
use super::meta::RecordMeta;
use super::pending::PendingFrames;
use super::recorded::Recorded;

/// An iterator over the frames of a recording or a capture, in the order of the file.
///
/// In a capture, a frame to the board has the time and the position of the submission of its transfer, and a report
/// those of the completion. A frame whose transfer was cancelled is left out. A frame is an interrupt transfer of 512
/// or 504 bytes, or of 513 with a report id of 0, or a SET_REPORT of such a length. Everything else is counted
/// ([`Recording::skipped`]). The iterator ends after an error.
pub struct Recording<R> {
    blocks: Blocks<R>,
    name: String,
    meta: Option<RecordMeta>,
    /// The metadata of the newest section, while frames of the section before are still in `pending`; the outer `None`:
    /// no section has begun since.
    next_meta: Option<Option<RecordMeta>>,
    lacks: Lacks,
    /// Whether the current section was written by the recorder of this crate and its end has not been read yet. If the
    /// next section or the end of the file comes first, the section counts as not ended.
    unended: bool,
    /// The link types of interfaces that carry no USB, for the error; `None` once an interface with USB was read.
    others: Option<Vec<String>>,
    devices: Devices,
    pending: PendingFrames,
    only: Option<Address>,
    /// The number of frames returned so far.
    frames: u64,
    /// The time in the file from which times count, ns; `None` before the first frame.
    zero_ns: Option<u64>,
    /// The metadata of the first section.
    first_meta: Option<RecordMeta>,
    /// Whether the file has a section of a recording. Such a file may be without frames.
    is_recording: bool,
    /// The result of the reading of blocks, once the file or the readable part has ended; `None` while there may be
    /// more.
    end: Option<Result<(), RecordError>>,
    ended: bool,
}

impl Recording<File> {
    /// Opens a file.
    ///
    /// # Errors
    /// [`RecordError`] if the file cannot be read or is no capture.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let name = path.display().to_string();
        match File::open(path) {
            Ok(file) => Self::new(file, &name),
            Err(error) => Err(RecordError::Io { name, message: error.to_string() }),
        }
    }
}

impl<R: Read> Recording<R> {
    /// Reads a recording from any source. `name` is its name in messages.
    ///
    /// # Errors
    /// [`RecordError`] if the beginning is not that of a capture.
    pub fn new(source: R, name: &str) -> Result<Self, RecordError> {
        let mut recording = Self {
            blocks: Blocks::new(source, name.to_owned()),
            name: name.to_owned(),
            meta: None,
            next_meta: None,
            lacks: Lacks::default(),
            unended: false,
            others: Some(Vec::new()),
            devices: Devices::default(),
            pending: PendingFrames::default(),
            only: None,
            frames: 0,
            zero_ns: None,
            first_meta: None,
            is_recording: false,
            end: None,
            ended: false,
        };
        // Reads the first block, so that `meta` has the metadata from the beginning.
        recording.step()?;
        recording.meta = recording.next_meta.take().flatten();
        recording.first_meta.clone_from(&recording.meta);
        Ok(recording)
    }

    /// Returns only the frames of one device, whatever ids its descriptor has.
    #[must_use]
    pub fn only(mut self, address: Address) -> Self {
        self.only = Some(address);
        self.devices.only(address);
        self
    }

    /// The metadata of the recording; `None` for a capture of another program. If a file has several recordings, these
    /// are the metadata of the frame read last.
    pub const fn meta(&self) -> Option<&RecordMeta> {
        self.meta.as_ref()
    }

    /// The time in the file from which times count, ns: see [`RecordMeta::zero_ns`]. If the file has several recordings,
    /// it is that of the first one. `None` before the first frame was read.
    pub const fn zero_ns(&self) -> Option<u64> {
        self.zero_ns
    }

    /// The number of frames known to be missing in the part read so far. A recording states it at its end.
    pub const fn missing(&self) -> u64 {
        self.lacks.missing
    }

    /// What is missing in the part read so far. Complete only after the last frame was read.
    pub fn lacks(&self) -> Lacks {
        self.lacks.clone().since(self.zero_ns, self.first_meta.as_ref())
    }

    /// The numbers of packets that were skipped in the part read so far.
    pub fn skipped(&self) -> Skipped {
        self.devices.skipped()
    }

    /// The USB devices with any packet in the part read so far, even without frames.
    pub fn devices(&self) -> Vec<CapturedDevice> {
        self.devices.seen()
    }

    /// Reads one block. Returns whether there was one.
    fn step(&mut self) -> Result<bool, RecordError> {
        let Some(item) = self.blocks.next()? else {
            self.lacks.not_ended += u64::from(std::mem::take(&mut self.unended));
            return Ok(false);
        };
        match item {
            Item::Section(meta, ours) => {
                self.pending.release();
                self.lacks.not_ended += u64::from(std::mem::replace(&mut self.unended, ours && meta.is_some()));
                self.is_recording |= meta.is_some();
                self.next_meta = Some(meta);
            }
            Item::Interface(link_type) if file_formats::is_usb(link_type) => self.others = None,
            Item::Interface(link_type) => {
                if let Some(others) = &mut self.others {
                    others.push(format!("{link_type:?}"));
                }
            }
            Item::Packet(packet) => {
                // A recording has no ends of transfers. The board got all its frames, so they need not wait.
                let waits = self.meta.is_none();
                let taken = match file_formats::event(&packet) {
                    Some(event) => self.devices.take(&event, packet.at_ns, waits, &mut self.pending),
                    None => Ok(()),
                };
                if let Err(Cut { captured, length }) = taken {
                    return Err(RecordError::Cut { name: self.name.clone(), offset: packet.offset, captured, length });
                }
            }
            Item::Counts { missing, why } => {
                self.unended = false;
                self.lacks.missing = self.lacks.missing.saturating_add(missing);
                self.lacks.why = why.or_else(|| self.lacks.why.take());
            }
            Item::Lost(lost) => self.lacks.damage.add(lost),
            Item::Other => {}
        }
        Ok(true)
    }

    fn next_frame(&mut self) -> Result<Option<Recorded>, RecordError> {
        loop {
            if let Some(frame) = self.pending.pop() {
                let zero_ns = || RecordMeta::zero_ns(self.first_meta.as_ref(), frame.at_ns);
                self.zero_ns.get_or_insert_with(zero_ns);
                self.frames += 1;
                return Ok(Some(frame));
            }
            // All frames of the section before have been returned, so the metadata of the new section apply.
            if let Some(meta) = self.next_meta.take() {
                self.meta = meta;
            }
            match self.end.take() {
                Some(end) => return end.and_then(|()| self.check()).map(|()| None),
                None => self.end = self.step().map(|more| (!more).then_some(())).transpose(),
            }
            if self.end.is_some() {
                self.pending.release();
            }
        }
    }

    /// Called at the end of the file. If it had no frames, returns the error that says why. Only a recording may have
    /// none.
    fn check(&mut self) -> Result<(), RecordError> {
        let name = self.name.clone();
        let of_network = format!("{:?}", DataLink::ETHERNET);
        let of_chip = format!("{:?}", file_formats::exchange::LINK_TYPE);
        match self.others.take() {
            Some(found) if found.contains(&of_chip) => Err(RecordError::OfChip { name }),
            Some(found) if found.is_empty() && self.lacks.damage.count > 0 => {
                let damage = self.lacks().damage;
                let next = if damage.whole.is_newer { "" } else { "; record again" };
                Err(RecordError::Unreadable { name, damage: format!("{damage}{next}") })
            }
            Some(found) if found.is_empty() => Err(RecordError::NoUsb { name, found: "no interface".to_owned() }),
            Some(found) if found.iter().all(|link_type| *link_type == of_network) => {
                Err(RecordError::OfNetwork { name })
            }
            Some(found) => Err(RecordError::NoUsb { name, found: found.join(", ") }),
            None if self.frames > 0 || self.is_recording => Ok(()),
            None => {
                let devices = self.devices();
                let found = if devices.is_empty() { "no transfer at all".to_owned() } else { devices::list(&devices) };
                Err(match self.only {
                    Some(asked) => RecordError::NoSuchDevice { name, asked, found },
                    None => RecordError::NoBoard { name, found },
                })
            }
        }
    }
}

impl<R: Read> Iterator for Recording<R> {
    type Item = Result<Recorded, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let mut frame = self.next_frame().transpose();
        if let Some(Ok(frame)) = &mut frame {
            frame.damage_before = self.lacks.damage.count;
        }
        self.ended = !matches!(frame, Some(Ok(_)));
        frame
    }
}

/// Finds the board in a capture: the device that looks most like a board, by its frames, and by its descriptor if the
/// capture has it. `None` if the file is a recording of this crate: that has only one board, and only its beginning is
/// read. A damaged capture is searched up to the damaged block.
///
/// # Errors
/// [`RecordError::NoBoard`]: no device looks like a board. [`RecordError::SeveralBoards`]: several devices look equally
/// like a board. Any other [`RecordError`]: the file cannot be read or is no capture.
pub fn board_in(path: &Path) -> Result<Option<Address>, RecordError> {
    board_of(Recording::open(path)?)
}

fn board_of<R: Read>(mut recording: Recording<R>) -> Result<Option<Address>, RecordError> {
    while !recording.is_recording {
        match recording.next() {
            Some(Ok(_)) => {}
            None | Some(Err(RecordError::Truncated { .. } | RecordError::Malformed { .. })) => break,
            Some(Err(error)) => return Err(error),
        }
    }
    if recording.is_recording {
        return Ok(None);
    }
    let (name, devices) = (recording.name.clone(), recording.devices());
    match devices::candidates(&devices)[..] {
        [] if devices.is_empty() => Err(RecordError::NoBoard { name, found: "no transfer at all".to_owned() }),
        [] => Err(RecordError::NoBoard { name, found: devices::list(&devices) }),
        [board] => Ok(Some(board.address)),
        [first, ..] => {
            let found = devices::list(&devices::candidates(&devices));
            Err(RecordError::SeveralBoards { name, found, example: first.address })
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// A source that counts the bytes read from it.
    struct Counted<'a>(&'a [u8], &'a Cell<usize>);

    impl Read for Counted<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            let read = self.0.read(buffer)?;
            self.1.set(self.1.get() + read);
            Ok(read)
        }
    }

    /// The first block of a recording shows that it has one board only, so little more than that block is read, whatever the
    /// length of the file.
    #[test]
    fn the_board_of_a_recording_is_known_by_its_beginning() {
        let padded = |bytes: &[u8]| [bytes, &vec![0; bytes.len().next_multiple_of(4) - bytes.len()]].concat();
        let block = |kind: u32, body: &[u8]| {
            let length = (12 + body.len() as u32).to_le_bytes();
            [&kind.to_le_bytes()[..], &length, body, &length].concat()
        };
        let comment = b"ecmsk slot=12 clock=virtual base_ns=0 link=sim:";
        let option =
            [&1_u16.to_le_bytes()[..], &(comment.len() as u16).to_le_bytes(), &padded(comment), &[0; 4]].concat();
        let header = [&0x1A2B_3C4D_u32.to_le_bytes()[..], &[1, 0, 0, 0], &[0xFF; 8], &option].concat();
        let custom = block(0x0BAD, &[0; 1000]).repeat(10_000);
        let file = [block(0x0A0D_0D0A, &header), custom].concat();
        let read = Cell::new(0);
        let recording = Recording::new(Counted(&file, &read), "file").expect("a recording");
        assert_eq!(board_of(recording).expect("no capture"), None);
        assert!(read.get() * 10 < file.len(), "{} bytes of {}", read.get(), file.len());
    }
}
