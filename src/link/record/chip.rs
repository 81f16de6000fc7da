//! The key `record=` of a link to a chip: a [`ChipLink`] that wraps another one and writes every exchange to a file,
//! which [`recording::exchanges`](crate::recording::exchanges) reads. It uses the same file handling, queue and thread
//! as recordings of a board, so that on the real clock no exchange waits for the disk.

use std::path::Path;

use pcap_file::DataLink;

use crate::ethercat::Ns;
use crate::link::chip_link::{ChipError, ChipInfo, ChipLink};
use crate::link::record::file::{self, Sink};
use crate::link::record::recorder::Recorder;
use crate::link::record::writer::Entry;
use crate::link::record::{PIPE_STALL_MAX, QUEUE_IN_VIRTUAL_TIME, next_step};
use crate::link::{Dir, Stamp};
use crate::recording::file_formats::ecmrec::header::What;
use crate::recording::file_formats::exchange;
use crate::recording::{Clock, RecordMeta};
use crate::xf::MAX_PACKET;
use crate::xf::host::Wires;

/// The most packets that wait for a slow disk on the real clock: both directions of an exchange every 250 us for half a
/// second. The 6 MB are allocated when the link is opened. \[OURS]
const QUEUE: usize = 4096;

/// The bytes of one direction of an exchange, queued for the file.
struct ExchangeEntry {
    at_ns: u64,
    dir: Dir,
    len: usize,
    bytes: [u8; MAX_PACKET],
}

impl Entry for ExchangeEntry {
    const LINK_TYPE: DataLink = exchange::LINK_TYPE;
    const HARDWARE: &'static str = "ECM-XF";
    const MAY_COME_LATE: bool = false;
    const PACKET_MAX: usize = 1 + MAX_PACKET;
    const WHAT: What = What::Chip;

    fn at_ns(&self) -> u64 {
        self.at_ns
    }

    fn dir(&self) -> Dir {
        self.dir
    }

    fn packet(&self, _: u64, packet: &mut [u8]) -> usize {
        packet[0] = exchange::mark(self.dir);
        packet[1..=self.len].copy_from_slice(&self.bytes[..self.len]);
        1 + self.len
    }

    fn bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

/// A link to a chip that records all exchanges of the link that it wraps.
///
/// An exchange is recorded when it has succeeded, as two packets: the bytes to the chip with the time at which the
/// exchange began, and the bytes from the chip with the time at which it ended. An exchange that is longer than the
/// longest packet of a chip becomes several packets of the file. Packets that are missing from the file are counted,
/// reported to the user and noted in the file, as in recordings of a board.
pub struct RecordedChip {
    inner: Box<dyn ChipLink>,
    recorder: Recorder<ExchangeEntry>,
}

impl RecordedChip {
    /// Records `inner` to the file at `path`. If this process has recorded to that file before, the recording is
    /// appended; otherwise the file is created, and an existing recording there is kept as `FILE.1`.
    ///
    /// # Errors
    /// [`ChipError::Wires`] if the file cannot be written or another recording is writing to it.
    pub fn new(inner: Box<dyn ChipLink>, path: &Path) -> Result<Self, ChipError> {
        let info = inner.info();
        let failed = |error: std::io::Error| ChipError::Wires {
            name: format!("cannot record to {}", path.display()),
            message: next_step(&error),
        };
        let file = file::open(path).map_err(failed)?;
        let begin = Stamp(inner.now());
        let meta = RecordMeta::begun(info.name, None, info.virtual_time, begin);
        let stall_max = (!file.is_on_disk()).then_some(PIPE_STALL_MAX);
        let meta = file.continued(&meta, begin);
        let queue = if meta.clock == Clock::Virtual { QUEUE_IN_VIRTUAL_TIME } else { QUEUE };
        let name = path.display().to_string();
        let recorder = Recorder::begin(&name, Sink::File(file), &meta, queue, stall_max).map_err(failed)?;
        Ok(Self { inner, recorder })
    }

    fn record(&self, dir: Dir, at: Ns, bytes: &[u8]) {
        for part in bytes.chunks(MAX_PACKET) {
            let (at_ns, len) = (self.recorder.file_ns(at), part.len());
            let mut entry = ExchangeEntry { at_ns, dir, len, bytes: [0; MAX_PACKET] };
            entry.bytes[..len].copy_from_slice(part);
            self.recorder.record(entry);
        }
    }
}

impl Wires for RecordedChip {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.inner.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        let begin = self.inner.now();
        self.inner.exchange(to_chip, from_chip)?;
        self.record(Dir::Write, begin, to_chip);
        self.record(Dir::Read, self.inner.now(), from_chip);
        Ok(())
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        self.inner.wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        self.inner.wait_ready(until)
    }
}

impl ChipLink for RecordedChip {
    fn info(&self) -> ChipInfo {
        self.inner.info()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.inner.int1()
    }

    fn reset(&mut self) -> Result<bool, ChipError> {
        self.inner.reset()
    }
}

impl Drop for RecordedChip {
    fn drop(&mut self) {
        self.recorder.finish();
    }
}
