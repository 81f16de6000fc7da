//! The link key `record=`: a [`Link`] around a link that writes every frame to a pcapng file. [`crate::recording`] reads
//! such files.
//!
//! A recording opens in Wireshark and has the form of a capture of the board's USB traffic by Linux' usbmon, whatever the
//! link: a command frame is the submission of a transfer to endpoint 0x02, a report the completion of one from 0x81.
//! Times are nanoseconds of the link's clock; if that is the real clock, they are counted from 1970
//! ([`RecordMeta::base_ns`]).
//!
//! Files, in the order in which to read them:
//!
//! - `mod.rs`: [`RecordLink`], which hands every frame to the recorder's thread
//! - `writer.rs`: that thread, which writes frames as pcapng blocks and the end of the recording
//! - `file.rs`: the file or pipe: new, continued or kept as `FILE.1`, and what happens when the disk is full
//! - `sync.rs`: when the operating system writes the file to the disk
//! - `tell.rs`: messages to the user of the program

mod file;
mod sync;
mod tell;
mod writer;

use std::io::{self, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

pub use file::make_room;

use super::{Dir, Layer, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::recording::{Clock, RecordMeta};
use crate::sk::Frame;
use crate::threads;
use file::Sink;
use writer::{Capture, Entry};

/// How many frames may wait for a slow disk on the real clock: both directions of a 250 us cycle for a second. The memory is
/// allocated when the link is opened. \[OURS]
pub const QUEUE: usize = 8192;

/// How many frames may wait for the disk on a virtual clock, where the caller waits for room. If the program crashes, at
/// most these are missing from the recording. \[OURS]
pub const QUEUE_IN_VIRTUAL_TIME: usize = 64;

/// How often the operating system is asked to write the recorded frames to the disk. \[OURS] If the program is killed,
/// nothing is lost of what the recorder has handed to the system; if the machine loses its power, at most this much.
pub const SYNC_EVERY: Duration = Duration::from_secs(1);

/// How long the reader of a pipe may read nothing before the recorder no longer waits for it. \[OURS]
const PIPE_STALL_MAX: Duration = Duration::from_secs(2);

/// A link that records all frames of another link.
///
/// A frame is recorded when the call that has written or read it has succeeded. On the real clock the caller never waits
/// for the disk: a frame for which the queue has no room is missing from the file and counted in
/// [`LinkStats::record_dropped`]. On a virtual clock the caller waits, since the board's time stands still meanwhile, and
/// no frame is missing. When the disk is full, or the reader of a pipe reads nothing for 2 s, all further frames are
/// only counted; the file stays a complete recording of those before. Frames that are missing are reported on standard
/// error, when the first one is lost and at the end, and in the file itself ([`Lacks`](crate::recording::Lacks)).
///
/// The file is complete when [`Link::close`] has returned or the link is dropped; before that, the newest frames may not
/// be in it yet. The system is asked every [`SYNC_EVERY`] to write it to the disk.
pub struct RecordLink {
    inner: Arc<dyn Link>,
    /// What is added to the link's time stamps to get those of the file.
    base_ns: u64,
    /// Whether a call waits for room in the queue: on a virtual clock.
    may_wait: bool,
    /// How long a call or the end of the recording waits for the reader of a pipe; `None` for a file.
    stall_max: Option<Duration>,
    /// Whether the reader of the pipe has read nothing for so long that calls do not wait for it any more.
    given_up: AtomicBool,
    /// Frames that are missing from the recording.
    dropped: Arc<AtomicU64>,
    /// The queue to the recorder's thread, `None` after [`Link::close`]. A call takes a clone of it before it begins; the
    /// recording ends when the last clone is dropped.
    entries: RwLock<Option<SyncSender<Entry>>>,
    writer: Mutex<Option<JoinHandle<()>>>,
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
        let queue = match meta.clock {
            Clock::Real => QUEUE,
            Clock::Virtual => QUEUE_IN_VIRTUAL_TIME,
        };
        let stall_max = (!file.is_on_disk()).then_some(PIPE_STALL_MAX);
        let meta = file.continued(meta, inner.info().opened_at);
        Self::begin(inner, &name, Sink::File(file), &meta, queue, stall_max)
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

    fn begin(
        inner: Arc<dyn Link>,
        name: &str,
        sink: Sink,
        meta: &RecordMeta,
        queue: usize,
        stall_max: Option<Duration>,
    ) -> Result<Self, LinkError> {
        let failed = |error: io::Error| cannot_record(name, &error);
        let dropped = Arc::new(AtomicU64::new(0));
        let capture = Capture::begin(name.to_owned(), sink, meta, Arc::clone(&dropped)).map_err(failed)?;
        let (sender, receiver) = sync_channel(queue.max(1));
        let writer = threads::spawn("ecmsk-record", move || writer::run(&receiver, capture)).map_err(failed)?;
        Ok(Self {
            inner,
            base_ns: meta.base_ns,
            may_wait: meta.clock == Clock::Virtual,
            stall_max,
            given_up: AtomicBool::new(false),
            dropped,
            entries: RwLock::new(Some(sender)),
            writer: Mutex::new(Some(writer)),
        })
    }

    fn entries(&self) -> Option<SyncSender<Entry>> {
        self.entries.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn record(&self, entries: Option<SyncSender<Entry>>, dir: Dir, at: Stamp, frame: &Frame) {
        let entry = Entry { at_ns: self.base_ns.saturating_add(at.0), dir, frame: frame.clone() };
        let taken = match entries {
            Some(entries) if self.may_wait => self.hand_over(&entries, entry),
            Some(entries) => entries.try_send(entry).is_ok(),
            None => false,
        };
        if !taken {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Waits for room in the queue, but not forever for the reader of a pipe, who may never read. Returns whether the frame
    /// was taken.
    fn hand_over(&self, entries: &SyncSender<Entry>, mut entry: Entry) -> bool {
        let Some(stall_max) = self.stall_max else { return entries.send(entry).is_ok() };
        let began = Instant::now();
        loop {
            match entries.try_send(entry) {
                Ok(()) => return true,
                Err(TrySendError::Disconnected(_)) => return false,
                Err(TrySendError::Full(back)) => entry = back,
            }
            if self.given_up.load(Ordering::Relaxed) || began.elapsed() > stall_max {
                self.given_up.store(true, Ordering::Relaxed);
                return false;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Waits for the calls that are in progress, then ends the recording.
    fn finish(&self) {
        drop(self.entries.write().unwrap_or_else(PoisonError::into_inner).take());
        // A second thread that closes the link waits here until the file is complete.
        let mut writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(thread) = writer.take() else { return };
        let Some(stall_max) = self.stall_max else {
            // If the thread has panicked, nobody can be told here.
            let _ = thread.join();
            return;
        };
        if !threads::end_within(thread, stall_max) {
            log::warn!("the recording lacks its end: the reader of its pipe has taken nothing for {stall_max:?}");
        }
    }
}

impl RecordMeta {
    /// The data for a link that is being opened and whose clock shows `link_time`.
    pub fn now(info: &LinkInfo, link_time: Stamp) -> Self {
        let (clock, base_ns) = if info.virtual_time {
            (Clock::Virtual, 0)
        } else {
            // A machine whose clock was never set may be before 1970.
            let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
            (Clock::Real, u64::try_from(unix).unwrap_or_default().saturating_sub(link_time.0))
        };
        Self { slot: info.slot, clock, base_ns, link: info.name.clone() }
    }
}

impl Layer for RecordLink {
    fn inner(&self) -> &dyn Link {
        &*self.inner
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let entries = self.entries();
        let at = self.inner.write(frame, wait)?;
        self.record(entries, Dir::Write, at, frame);
        Ok(at)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let entries = self.entries();
        let meta = self.inner.read(out, wait)?;
        self.record(entries, Dir::Read, meta.at, out);
        Ok(meta)
    }

    fn close(&self) {
        // This ends the calls in progress, for which the recording waits.
        self.inner.close();
        self.finish();
    }

    fn vanish(&self) {
        self.inner.vanish();
        self.finish();
    }

    fn stats(&self) -> LinkStats {
        let mut stats = self.inner.stats();
        stats.record_dropped += self.dropped.load(Ordering::Relaxed);
        stats
    }
}

impl Drop for RecordLink {
    fn drop(&mut self) {
        // Stopping the axes is more urgent than writing to the disk.
        if Arc::strong_count(&self.inner) == 1 {
            self.inner.vanish();
        }
        self.finish();
    }
}

fn cannot_record(name: &str, error: &io::Error) -> LinkError {
    LinkError::Io {
        what: format!("cannot record to {name}"),
        message: format!("{error}; name another file with record= or leave it out"),
    }
}
