//! Syncs a growing recording to the disk, so that little of it is lost if the machine loses its power.

use std::fs::File;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::SYNC_EVERY;
use crate::threads;

/// How long the end of a recording waits for its last sync. \[OURS]
const END_WAIT_MAX: Duration = Duration::from_secs(2);

/// A thread that syncs the file to the disk every [`SYNC_EVERY`]. The recorder's thread does not do it itself, because
/// a sync may take seconds, in which frames would have to wait.
pub(super) struct Syncing {
    shared: Arc<Shared>,
    /// A channel that carries no messages: dropping this sender makes the thread end.
    running: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    /// Whether something was written since the last sync.
    written: AtomicBool,
    /// The error of a sync that failed, until [`Syncing::check`] takes it.
    failed: Mutex<Option<io::Error>>,
}

impl Syncing {
    /// Starts the thread. `None` if the system provides no further file handle or thread; the system then writes the
    /// file to the disk when it chooses to.
    pub(super) fn begin(file: &File) -> Option<Self> {
        let file = file.try_clone().ok()?;
        let shared = Arc::new(Shared::default());
        let (running, stopped) = channel::<()>();
        let seen = Arc::clone(&shared);
        let work = move || {
            while stopped.recv_timeout(SYNC_EVERY) == Err(RecvTimeoutError::Timeout) {
                if seen.written.swap(false, Ordering::Relaxed)
                    && let Err(error) = file.sync_data()
                {
                    *seen.failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    return;
                }
            }
        };
        let thread = threads::spawn("ecmsk-sync", work).ok()?;
        Some(Self { shared, running: Some(running), thread: Some(thread) })
    }

    /// Notes that something was written to the file.
    pub(super) fn written(&self) {
        self.shared.written.store(true, Ordering::Relaxed);
    }

    /// Fails if an earlier sync has failed.
    ///
    /// # Errors
    /// The error of that sync.
    pub(super) fn check(&self) -> io::Result<()> {
        self.shared.failed.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

/// Waits for the thread: until it has ended, it uses the file and the code of this library.
impl Drop for Syncing {
    fn drop(&mut self) {
        drop(self.running.take());
        if let Some(thread) = self.thread.take()
            && !threads::end_within(thread, END_WAIT_MAX)
        {
            log::warn!("the disk has not taken the end of the recording for {END_WAIT_MAX:?}");
        }
    }
}
