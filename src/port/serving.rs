//! The thread of a server with a single thread: how its owner ends it, and the state that both share.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use crate::notes::NoteThread;
use crate::tcp::Waker;
use crate::threads;

/// The state that the thread and its owner share.
pub(super) struct Shared {
    is_stopping: AtomicBool,
    /// Ends a wait of the thread.
    pub(super) waker: Waker,
}

impl Shared {
    pub(super) fn new() -> io::Result<Arc<Self>> {
        Ok(Arc::new(Self { is_stopping: AtomicBool::new(false), waker: Waker::new()? }))
    }

    /// Whether the owner has asked the thread to end.
    pub(super) fn is_stopping(&self) -> bool {
        self.is_stopping.load(Ordering::Acquire)
    }
}

/// A handle of the server's thread and of the thread of its log. Dropping it ends both.
pub(super) struct Serving {
    shared: Arc<Shared>,
    teller: NoteThread<String>,
    thread: Option<JoinHandle<()>>,
}

impl Serving {
    /// Starts a thread of that name, which ends when [`Shared::is_stopping`].
    pub(super) fn start(
        name: &str,
        shared: Arc<Shared>,
        teller: NoteThread<String>,
        run: impl FnOnce() + Send + 'static,
    ) -> io::Result<Self> {
        let thread = threads::spawn(name, run)?;
        Ok(Self { shared, teller, thread: Some(thread) })
    }

    /// Waits until all lines so far are logged, at most 1 s.
    pub(super) fn flush(&self) {
        self.teller.flush();
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        self.shared.is_stopping.store(true, Ordering::Release);
        self.shared.waker.wake();
        if let Some(thread) = self.thread.take() {
            // A panic of that thread was printed when it happened.
            let _ = thread.join();
        }
        self.teller.end();
    }
}
