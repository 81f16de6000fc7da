//! The link key `record=`: a [`Link`] around a link that writes every frame to a pcapng file. [`crate::recording`] reads it.
//!
//! A recording opens in Wireshark and looks like a capture of the board's USB traffic by Linux' usbmon. What the host
//! writes is the submission of a transfer to endpoint 0x02, what it reads the completion of one from 0x81. Times are
//! nanoseconds of the link's clock, moved to the calendar where that clock is real ([`RecordMeta::base_ns`]).

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

/// Frames that may wait for a slow disk, in memory that is taken at the start: both directions of a 250 us cycle for a
/// second. \[OURS]
pub const QUEUE: usize = 8192;

/// The same on a virtual clock, where a caller may wait: a program that crashes loses no more than these \[OURS].
pub const QUEUE_IN_VIRTUAL_TIME: usize = 64;

/// How often the system is asked to bring what was recorded to the disk. \[OURS] It has it from the moment on that the
/// recorder writes it: a program that is killed loses nothing of that, a machine without power no more than this.
pub const SYNC_EVERY: Duration = Duration::from_secs(1);

/// How long a pipe's reader may take nothing before it is given up. \[OURS]
const PIPE_PATIENCE: Duration = Duration::from_secs(2);

/// A link that records.
///
/// A frame is in the recording once the call that moved it has succeeded. On the real clock the caller never waits for
/// the disk: a frame for which there is no room is counted in [`LinkStats::record_dropped`]. On a virtual clock it
/// waits, as no time passes meanwhile, and nothing is lost. When the disk is full the recording ends, whole, and all
/// further frames are counted. So they are when the reader of a pipe takes nothing for 2 s. Whoever runs the program is
/// told of it on standard error, once when it begins and once at the end, and so is the reader of the file ([`Lacks`](crate::recording::Lacks)).
///
/// The file is complete when [`Link::close`] has returned or the link is dropped; before, it lags by what the disk has
/// not taken yet. What the system has of it goes to the disk every [`SYNC_EVERY`].
pub struct RecordLink {
    inner: Arc<dyn Link>,
    base_ns: u64,
    may_wait: bool,
    patience: Option<Duration>,
    given_up: AtomicBool,
    dropped: Arc<AtomicU64>,
    /// Taken away by [`Link::close`]. A call takes a clone before it begins: the recording ends when the last is gone.
    entries: RwLock<Option<SyncSender<Entry>>>,
    writer: Mutex<Option<JoinHandle<()>>>,
}

impl RecordLink {
    /// Records `inner` to the file at `path`. The process's first recording to a file begins it, and a recording that is
    /// there is kept as `FILE.1`; later ones append.
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
        let patience = (!file.is_on_disk()).then_some(PIPE_PATIENCE);
        let meta = file.continued(meta, inner.info().opened_at);
        Self::begin(inner, &name, Sink::File(file), &meta, queue, patience)
    }

    /// Records `inner` to anything that takes bytes; up to `queue` frames wait for it. `name` is for messages.
    ///
    /// # Errors
    /// [`LinkError::Io`] if the headers cannot be written or there can be no more threads.
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
        patience: Option<Duration>,
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
            patience,
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

    /// Waits for room, but not without end for somebody who may never read.
    fn hand_over(&self, entries: &SyncSender<Entry>, mut entry: Entry) -> bool {
        let Some(patience) = self.patience else { return entries.send(entry).is_ok() };
        let began = Instant::now();
        loop {
            match entries.try_send(entry) {
                Ok(()) => return true,
                Err(TrySendError::Disconnected(_)) => return false,
                Err(TrySendError::Full(back)) => entry = back,
            }
            if self.given_up.load(Ordering::Relaxed) || began.elapsed() > patience {
                self.given_up.store(true, Ordering::Relaxed);
                return false;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Ends the recording once no call can add to it any more.
    fn finish(&self) {
        drop(self.entries.write().unwrap_or_else(PoisonError::into_inner).take());
        // A second closer waits here until the first one's file is complete.
        let mut writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(thread) = writer.take() else { return };
        let Some(patience) = self.patience else {
            // That it panicked cannot be told to anybody here.
            let _ = thread.join();
            return;
        };
        if !threads::end_within(thread, patience) {
            log::warn!("the recording lacks its end: the reader of its pipe has taken nothing for {patience:?}");
        }
    }
}

impl RecordMeta {
    /// For a link that is just being opened and whose clock shows `link_time`.
    pub fn now(info: &LinkInfo, link_time: Stamp) -> Self {
        let (clock, base_ns) = if info.virtual_time {
            (Clock::Virtual, 0)
        } else {
            // A clock before 1970 is one that was never set.
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
        // First, so that the calls under way end: the recording waits for them.
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
        // What stops axes comes before what has to be written to a disk.
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
