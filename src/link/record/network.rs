//! Recordings of Ethernet frames, for a network whose slaves are simulated: a pcapng file that Wireshark dissects.

use std::io;
use std::path::Path;

use pcap_file::DataLink;

use super::file::{self, Sink};
use super::recorder::Recorder;
use super::writer::Entry;
use super::{Dir, PIPE_STALL_MAX, Stamp};
use crate::ethercat::FRAME_LEN_MAX;
use crate::fieldbus::Ns;
use crate::recording::RecordMeta;
use crate::recording::file_formats::ecmrec::header::What;

/// The most frames that wait for a slow disk: both directions of a cycle of 250 us for half a second. The 6 MB are
/// allocated when the recording begins. \[OURS]
const QUEUE: usize = 4096;

/// A frame that is queued for the file.
struct NetworkEntry {
    at_ns: u64,
    dir: Dir,
    len: usize,
    bytes: [u8; FRAME_LEN_MAX],
}

impl Entry for NetworkEntry {
    const LINK_TYPE: DataLink = DataLink::ETHERNET;
    const HARDWARE: &'static str = "EtherCAT";
    const MAY_COME_LATE: bool = false;
    const PACKET_MAX: usize = FRAME_LEN_MAX;
    const WHAT: What = What::Network;

    fn at_ns(&self) -> u64 {
        self.at_ns
    }

    fn dir(&self) -> Dir {
        self.dir
    }

    fn packet(&self, _: u64, packet: &mut [u8]) -> usize {
        packet[..self.len].copy_from_slice(&self.bytes[..self.len]);
        self.len
    }

    fn bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

/// A recording of the frames of a network; it ends when it is dropped. No call waits for the disk: a frame for which
/// the queue has no room is missing. Missing frames are counted, reported and noted in the file, as in recordings of a
/// board.
pub struct NetworkRecording {
    recorder: Recorder<NetworkEntry>,
}

impl NetworkRecording {
    /// Records to a new file at `path`; an existing recording there is kept as `FILE.1`. `name` is the name of the
    /// network in the file, and `now` the present time of the clock that [`Self::record`] uses.
    ///
    /// # Errors
    /// The file cannot be written, or another recording is writing to it.
    pub fn begin(path: &Path, name: String, now: Ns) -> io::Result<Self> {
        let file = file::open(path)?;
        let stall_max = (!file.is_on_disk()).then_some(PIPE_STALL_MAX);
        let meta = file.continued(&RecordMeta::begun(name, None, false, Stamp(now)), Stamp(now));
        let recorder = Recorder::begin(&path.display().to_string(), Sink::File(file), &meta, QUEUE, stall_max)?;
        Ok(Self { recorder })
    }

    /// Records a frame of the master (`Write`) or its answer (`Read`). A frame too long for Ethernet is cut.
    pub fn record(&self, dir: Dir, at: Ns, frame: &[u8]) {
        let len = frame.len().min(FRAME_LEN_MAX);
        let mut entry = NetworkEntry { at_ns: self.recorder.file_ns(at), dir, len, bytes: [0; FRAME_LEN_MAX] };
        entry.bytes[..len].copy_from_slice(&frame[..len]);
        self.recorder.record(entry);
    }
}

impl Drop for NetworkRecording {
    fn drop(&mut self) {
        self.recorder.finish();
    }
}
