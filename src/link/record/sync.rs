//! Brings a recording to the disk while it grows: a machine that loses its power loses no more than a few moments of it.

use std::fs::File;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::SYNC_EVERY;
use crate::threads;

/// How long the end of a recording waits for a disk that is asked to take it. \[OURS]
const PATIENCE: Duration = Duration::from_secs(2);

/// A thread of its own asks the system for it: a disk may take seconds, and frames wait for nothing but their write.
pub(super) struct Syncing {
    shared: Arc<Shared>,
    /// Nothing is sent; the thread ends when it is gone.
    going: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    written: AtomicBool,
    /// What the disk said, if it did not take what the system had taken.
    failed: Mutex<Option<io::Error>>,
}

impl Syncing {
    /// `None` where the system gives no more files or threads: then it brings the file to the disk when it likes.
    pub(super) fn begin(file: &File) -> Option<Self> {
        let file = file.try_clone().ok()?;
        let shared = Arc::new(Shared::default());
        let (going, gone) = channel::<()>();
        let seen = Arc::clone(&shared);
        let work = move || {
            while gone.recv_timeout(SYNC_EVERY) == Err(RecvTimeoutError::Timeout) {
                if seen.written.swap(false, Ordering::Relaxed)
                    && let Err(error) = file.sync_data()
                {
                    *seen.failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    return;
                }
            }
        };
        let thread = threads::spawn("ecmsk-sync", work).ok()?;
        Some(Self { shared, going: Some(going), thread: Some(thread) })
    }

    /// There is something new in the file.
    pub(super) fn written(&self) {
        self.shared.written.store(true, Ordering::Relaxed);
    }

    /// # Errors
    /// What the disk said of what was written before.
    pub(super) fn check(&self) -> io::Result<()> {
        self.shared.failed.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

/// The thread has the file and this library's code until it has ended.
impl Drop for Syncing {
    fn drop(&mut self) {
        drop(self.going.take());
        if let Some(thread) = self.thread.take()
            && !threads::end_within(thread, PATIENCE)
        {
            log::warn!("the disk has not taken the end of the recording for {PATIENCE:?}");
        }
    }
}
