//! The link key `record=`: a [`Link`] around a link that writes every frame to a file. [`crate::recording`] reads such
//! files.
//!
//! The name of the file decides its format: `FILE.ecmrec` is one for recordings of weeks, compressed, with an index
//! (why: docs/decisions/recordings-of-weeks-are-blocks.md). Any other name is pcapng. Such a recording opens in
//! Wireshark and has the form of a capture of the board's USB traffic by Linux' usbmon, whatever the link: a command
//! frame is the submission of a transfer to endpoint 0x02, a report the completion of one from 0x81. Times are
//! nanoseconds of the link's clock; if that is the real clock, they are counted from 1970 ([`RecordMeta::base_ns`]).
//!
//! Files, in the order in which to read them:
//!
//! - `mod.rs`: [`RecordLink`], which hands every frame to the recorder's thread
//! - `recorder.rs`: a running recording, and its end
//! - `queue.rs`: the queue of frames, or of a chip's packets, to the recorder's thread; `ring.rs`: its ring buffer
//! - `writer.rs`: the recorder's thread, which writes frames as pcapng blocks, and the end of the recording;
//!   `blocks.rs`: the same in the format `.ecmrec`; `loss.rs`: what the file lacks
//! - `file.rs`: the file or pipe: new, continued or kept as `FILE.1`, and the handling of a full disk
//! - `copy.rs`: writing frames of another recording; `settings.rs`: the commands without which they cannot be
//!   understood
//! - `flight/`: the key `flight=`: the frames of the last hours, and those around an event
//! - `network.rs`: recordings of EtherCAT frames on a network
//! - `sync.rs`: syncing the file to the disk
//! - `tell.rs`: messages to the user of the program

mod blocks;
mod chip;
mod copy;
pub(super) mod file;
pub mod flight;
mod loss;
#[cfg(all(feature = "serve", target_os = "linux"))]
mod network;
mod queue;
pub(super) mod recorder;
mod ring;
mod settings;
mod sync;
mod tell;
pub(super) mod writer;

use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

pub use chip::RecordedChip;
pub use copy::RecordingCopy;
pub use file::{check_room, make_room};
#[cfg(all(feature = "serve", target_os = "linux"))]
pub use network::NetworkRecording;

use super::{Dir, Layer, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::recording::{Clock, RecordMeta};
use crate::sk::{Frame, SlotSize};
use file::Sink;
use flight::{Flight, FlightOptions, FlightWatch};
use recorder::{RecordedCall, Recorder};
use writer::FrameEntry;

/// The most frames that wait for a slow disk on the real clock: both directions of a 250 us cycle for a second. The
/// memory is allocated when the link is opened. \[OURS]
pub const QUEUE: usize = 8192;

/// The most frames that wait for the disk on a virtual clock, where the caller waits for room. If the program crashes,
/// at most this many frames are missing from the recording. \[OURS]
pub const QUEUE_IN_VIRTUAL_TIME: usize = 64;

/// How often the recorded frames are synced to the disk. \[OURS] If the program is killed, all frames that the recorder
/// has handed to the system are kept. If the machine loses its power, the frames of the last interval may be lost.
pub const SYNC_EVERY: Duration = Duration::from_secs(1);

/// How long the reader of a pipe may read nothing before the recorder stops waiting for it. \[OURS]
pub(super) const PIPE_STALL_MAX: Duration = Duration::from_secs(2);

/// A link that records all frames of another link.
///
/// A frame is recorded when the call that has written or read it has succeeded. On the real clock the caller never
/// waits for the disk: a frame for which the queue has no room is missing from the file and counted in
/// [`LinkStats::record_dropped`]. On a virtual clock the caller waits, since the board's time stands still meanwhile,
/// and no frame is missing. When the disk is full, or the reader of a pipe reads nothing for 2 s, all further frames
/// are only counted; the file stays a complete recording of the frames before. Frames that are missing are reported on
/// standard error, when the first one is lost and at the end, and in the file itself
/// ([`Lacks`](crate::recording::Lacks)).
///
/// The file is complete when [`Link::close`] has returned or the link is dropped; before that, the newest frames may
/// not be in it yet. Every [`SYNC_EVERY`] the file is synced to the disk.
pub struct RecordLink {
    inner: Arc<dyn Link>,
    recorder: Recorder<FrameEntry>,
    /// See [`Link::recorded_before`].
    before: Duration,
}

impl RecordLink {
    /// Records `inner` to the file at `path`. The first recording of this process to that file makes a new file and keeps
    /// an existing recording as `FILE.1`; later ones of this process are appended.
    ///
    /// # Errors
    /// [`LinkError::Io`] naming the file if it cannot be written or another recording is writing to it.
    pub fn new(inner: Arc<dyn Link>, path: &Path, meta: &RecordMeta) -> Result<Self, LinkError> {
        let name = path.display().to_string();
        let file = file::open(path).map_err(|error| cannot_record(&name, &error))?;
        let queue = queue_len(meta.clock);
        let stall_max = (!file.is_on_disk()).then_some(PIPE_STALL_MAX);
        let meta = file.continued(meta, inner.info().opened_at);
        let before = file.before(&meta);
        let mut link = Self::begin(inner, &name, Sink::File(file), &meta, queue, stall_max)?;
        link.before = before;
        Ok(link)
    }

    /// Records `inner` to any writer; up to `queue` frames wait for it. `name` is the name of the writer in messages.
    ///
    /// # Errors
    /// [`LinkError::Io`] if the headers cannot be written or the system provides no thread.
    pub fn to_sink(
        inner: Arc<dyn Link>,
        name: &str,
        sink: Box<dyn Write + Send>,
        meta: &RecordMeta,
        queue: usize,
    ) -> Result<Self, LinkError> {
        Self::begin(inner, name, Sink::Other(sink), meta, queue, None)
    }

    /// Records `inner` to a [flight recorder](flight). `watch` finds the moments to keep.
    ///
    /// # Errors
    /// [`LinkError::Io`] naming the folder if it cannot be written, or another process is recording to it.
    pub fn to_flight(
        inner: Arc<dyn Link>,
        options: &FlightOptions,
        meta: &RecordMeta,
        watch: Box<dyn FlightWatch>,
    ) -> Result<Self, LinkError> {
        let failed = |error: io::Error| LinkError::Io {
            what: format!("cannot record to the folder {}", options.folder.display()),
            message: format!("{error}; name another folder with flight= or leave it out"),
        };
        let dropped = Arc::default();
        let flight = Flight::begin(options, meta, watch, Arc::clone(&dropped)).map_err(failed)?;
        let recorder = Recorder::run(flight, dropped, meta, queue_len(meta.clock), None).map_err(failed)?;
        Ok(Self { inner, recorder, before: Duration::ZERO })
    }

    fn begin(
        inner: Arc<dyn Link>,
        name: &str,
        sink: Sink,
        meta: &RecordMeta,
        queue: usize,
        stall_max: Option<Duration>,
    ) -> Result<Self, LinkError> {
        let recorder =
            Recorder::begin(name, sink, meta, queue, stall_max).map_err(|error| cannot_record(name, &error))?;
        Ok(Self { inner, recorder, before: Duration::ZERO })
    }

    fn record(&self, call: &RecordedCall<'_, FrameEntry>, dir: Dir, at: Stamp, frame: &Frame) {
        let entry = FrameEntry { at_ns: self.recorder.file_ns(at.0), dir, frame: frame.clone() };
        call.record(entry);
    }
}

impl RecordMeta {
    /// The metadata for a link that is just being opened. `link_time`: the present time of its clock.
    pub fn now(info: &LinkInfo, link_time: Stamp) -> Self {
        Self::begun(info.name.clone(), info.slot, info.virtual_time, link_time)
    }

    /// The metadata for a recording of the link with the URI `link` that begins now. `link_time`: the present time of
    /// the link's clock.
    pub(super) fn begun(link: String, slot: Option<SlotSize>, virtual_time: bool, link_time: Stamp) -> Self {
        let (clock, base_ns) = if virtual_time {
            (Clock::Virtual, 0)
        } else {
            // The clock of a machine that was never set may show a time before 1970, which is taken as 1970.
            let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
            (Clock::Real, u64::try_from(unix).unwrap_or_default().saturating_sub(link_time.0))
        };
        Self { slot, clock, base_ns, opened_ns: Some(link_time.0), link, machine: None }
    }
}

impl Layer for RecordLink {
    fn inner(&self) -> &dyn Link {
        &*self.inner
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let call = self.recorder.call();
        let at = self.inner.write(frame, wait)?;
        self.record(&call, Dir::Write, at, frame);
        Ok(at)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let call = self.recorder.call();
        let meta = self.inner.read(out, wait)?;
        self.record(&call, Dir::Read, meta.at, out);
        Ok(meta)
    }

    fn close(&self) {
        // Closing the inner link ends the calls in progress. The recording waits for their frames.
        self.inner.close();
        self.recorder.finish();
    }

    fn vanish(&self) {
        self.inner.vanish();
        self.recorder.finish();
    }

    fn stats(&self) -> LinkStats {
        let mut stats = self.inner.stats();
        stats.record_dropped += self.recorder.dropped();
        stats
    }

    fn recorded_before(&self) -> Duration {
        self.before
    }
}

impl Drop for RecordLink {
    fn drop(&mut self) {
        // The inner link is closed first, if nothing else uses it: a server behind it stops the axes, which is more
        // urgent than writing to the disk.
        if Arc::strong_count(&self.inner) == 1 {
            self.inner.vanish();
        }
        self.recorder.finish();
    }
}

/// How many frames wait for the disk at most.
const fn queue_len(clock: Clock) -> usize {
    match clock {
        Clock::Real => QUEUE,
        Clock::Virtual => QUEUE_IN_VIRTUAL_TIME,
    }
}

fn cannot_record(name: &str, error: &io::Error) -> LinkError {
    LinkError::Io { what: format!("cannot record to {name}"), message: next_step(error) }
}

/// The error of the system, followed by what the user can do if nothing can be recorded to a file.
pub(super) fn next_step(error: &io::Error) -> String {
    format!("{error}; name another file with record= or leave it out")
}
