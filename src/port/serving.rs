//! The thread of a server that needs only one thread: how the server ends it, and the state that both share.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use crate::notes::NoteThread;
use crate::tcp::Waker;
use crate::threads;

/// The state that the server and its thread share.
pub(super) struct Shared {
    is_stopping: AtomicBool,
    /// Ends the wait of the server's thread.
    pub(super) waker: Waker,
}

impl Shared {
    pub(super) fn new() -> io::Result<Arc<Self>> {
        Ok(Arc::new(Self { is_stopping: AtomicBool::new(false), waker: Waker::new()? }))
    }

    /// Whether the server has asked its thread to end.
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
    /// Starts a thread with this name. The function that it runs has to return once [`Shared::is_stopping`] returns
    /// true. Fails if the system provides no thread.
    pub(super) fn start(
        name: &str,
        shared: Arc<Shared>,
        teller: NoteThread<String>,
        run: impl FnOnce() + Send + 'static,
    ) -> io::Result<Self> {
        let thread = threads::spawn(name, run)?;
        Ok(Self { shared, teller, thread: Some(thread) })
    }

    /// Waits until all lines so far were passed to the log function, at most 1 s.
    pub(super) fn flush(&self) {
        self.teller.flush();
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        self.shared.is_stopping.store(true, Ordering::Release);
        self.shared.waker.wake();
        if let Some(thread) = self.thread.take() {
            // An error is ignored: it means that the thread has panicked, and that was printed when it happened.
            let _ = thread.join();
        }
        self.teller.end();
    }
}
