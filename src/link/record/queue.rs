//! The queue to the recorder's thread, which no call on the real clock waits for.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::file::Sink;
use super::writer::{self, Capture, Entry};
use crate::recording::{Clock, RecordMeta};
use crate::threads::{self, Caller};

/// How long the end of a recording waits for the calls under way, which end with their link. \[OURS]
const CALLS_LIMIT: Duration = Duration::from_secs(10);

/// A recording that is being made.
pub(in crate::link) struct Recorder<E> {
    /// What is added to the link's times to get those of the file.
    base_ns: u64,
    /// Whether a call waits for room in the queue: on a virtual clock.
    may_wait: bool,
    /// How long a call or the end of the recording waits for the reader of a pipe; `None` for a file.
    stall_max: Option<Duration>,
    /// Whether the reader of the pipe has read nothing for so long that calls do not wait for it any more.
    given_up: AtomicBool,
    /// Frames that are missing from the recording.
    dropped: Arc<AtomicU64>,
    /// The queue to the recorder's thread, `None` after [`Self::finish`]. A call takes a clone of it before it begins; the
    /// recording ends when the last clone is dropped, or with a `None` in the queue.
    entries: RwLock<Option<SyncSender<Option<E>>>>,
    /// The threads that are in a call.
    callers: Mutex<Vec<Caller>>,
    writer: Mutex<Option<JoinHandle<()>>>,
}

impl<E: Entry> Recorder<E> {
    /// Begins a recording to `sink`; up to `queue` entries wait for it. `name` is its name in messages.
    ///
    /// # Errors
    /// The headers cannot be written, or the system provides no thread.
    pub fn begin(
        name: &str,
        sink: Sink,
        meta: &RecordMeta,
        queue: usize,
        stall_max: Option<Duration>,
    ) -> io::Result<Self> {
        let dropped = Arc::new(AtomicU64::new(0));
        let capture = Capture::<E>::begin(name.to_owned(), sink, meta, Arc::clone(&dropped))?;
        let (sender, receiver) = sync_channel(queue.max(1));
        let writer = threads::spawn("ecmsk-record", move || writer::run(&receiver, capture))?;
        Ok(Self {
            base_ns: meta.base_ns,
            may_wait: meta.clock == Clock::Virtual,
            stall_max,
            given_up: AtomicBool::new(false),
            dropped,
            entries: RwLock::new(Some(sender)),
            callers: Mutex::default(),
            writer: Mutex::new(Some(writer)),
        })
    }

    /// The time in the file for a time of the link, in nanoseconds.
    pub const fn file_ns(&self, link_ns: u64) -> u64 {
        self.base_ns.saturating_add(link_ns)
    }

    /// The queue; `None`: the recording has ended.
    pub fn entries(&self) -> Option<SyncSender<Option<E>>> {
        self.entries.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Begins a call of a program, for whose end [`Self::finish`] waits, with the queue as it is now.
    pub fn call(&self) -> RecordedCall<'_, E> {
        let caller = Caller::current();
        self.callers().push(caller);
        RecordedCall { recorder: self, caller, entries: self.entries() }
    }

    fn callers(&self) -> MutexGuard<'_, Vec<Caller>> {
        self.callers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Entries that are missing from the recording.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Records an entry, or counts it as missing.
    pub fn record(&self, entries: Option<&SyncSender<Option<E>>>, entry: E) {
        let taken = match entries {
            Some(entries) if self.may_wait => self.hand_over(entries, Some(entry)),
            Some(entries) => entries.try_send(Some(entry)).is_ok(),
            None => false,
        };
        if !taken {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Waits for room in the queue, but not forever for the reader of a pipe, who may never read. Returns whether the frame
    /// was taken.
    fn hand_over(&self, entries: &SyncSender<Option<E>>, mut entry: Option<E>) -> bool {
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
    pub fn finish(&self) {
        let entries = self.entries.write().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(entries) = entries
            && self.wait_for_calls()
        {
            self.hand_over(&entries, None);
        }
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

    /// Waits until all threads have left their calls; whether one of them has not, and never will, since it was ended by force.
    fn wait_for_calls(&self) -> bool {
        let began = Instant::now();
        loop {
            let (all, are_gone) = {
                let callers = self.callers();
                (callers.len(), callers.iter().filter(|caller| caller.is_gone()).count())
            };
            if all == are_gone || began.elapsed() > CALLS_LIMIT {
                return all > 0;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// A call of a program that is recorded.
pub(in crate::link) struct RecordedCall<'a, E> {
    recorder: &'a Recorder<E>,
    caller: Caller,
    pub entries: Option<SyncSender<Option<E>>>,
}

impl<E> Drop for RecordedCall<'_, E> {
    fn drop(&mut self) {
        let mut callers = self.recorder.callers.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = callers.iter().position(|caller| *caller == self.caller) {
            callers.swap_remove(own);
        }
    }
}
