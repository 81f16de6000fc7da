//! Runs calls that may wait long for the board: Ctrl-C ends them, and their progress is shown after a second.

use std::panic::resume_unwind;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::ecm::{Ecm, EcmError};
use ecmsk::link::Dir;
use serde_json::json;

use super::error::BoardError;
use super::session::Board;

/// \[OURS] The interval at which signals are checked during a call.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// \[OURS] After Ctrl-C and `stop`, a call has this long to end by itself; then it is cancelled.
const STOP_LIMIT: Duration = Duration::from_secs(1);
impl Board {
    /// Runs a long call in a separate thread, so that Ctrl-C can end it, and shows its progress after a second.
    ///
    /// # Errors
    /// [`BoardError::Stopped`] if a signal has ended the call; otherwise the errors of the call.
    pub fn run_interruptible<T: Send>(
        &self,
        what: &str,
        work: impl FnOnce(&Ecm) -> Result<T, EcmError> + Send,
    ) -> Result<T, BoardError> {
        self.run_stoppable(what, work, None)
    }

    /// Like [`Board::run_interruptible`], but Ctrl-C first calls `stop`, which should make the call end by itself.
    pub fn run_stoppable<T: Send>(
        &self,
        what: &str,
        work: impl FnOnce(&Ecm) -> Result<T, EcmError> + Send,
        stop: Option<&dyn Fn()>,
    ) -> Result<T, BoardError> {
        self.check_stop()?;
        let began = Instant::now();
        let mut pace = self.reporter.pace();
        let mut stopped: Option<Instant> = None;
        let (ecm, (running, ended)) = (&self.ecm, mpsc::channel::<()>());
        let done: Result<_, BoardError> = thread::scope(|scope| {
            let worker = thread::Builder::new().spawn_scoped(scope, move || {
                let _running = running;
                work(ecm)
            });
            let worker = worker.map_err(BoardError::system("start a thread"))?;
            while ended.recv_timeout(POLL_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                if self.interrupt.signal().is_some() {
                    if stopped.is_none() {
                        stop.into_iter().for_each(|stop| stop());
                    }
                    let since = *stopped.get_or_insert_with(Instant::now);
                    if stop.is_none() || since.elapsed() > STOP_LIMIT {
                        // Every call waits for a report or for a write, so cancelling both directions of the link ends
                        // the call.
                        self.link.cancel(Dir::Read);
                        self.link.cancel(Dir::Write);
                    }
                }
                if stop.is_none() && pace.due(began.elapsed()) {
                    let seconds = began.elapsed().as_secs();
                    // An error of standard output is ignored here; it is reported when the result is printed.
                    let _ = self.reporter.progress(
                        format_args!("{what}, {seconds} s"),
                        || json!({"progress": what, "seconds": seconds}),
                    );
                }
            }
            Ok(worker.join().unwrap_or_else(|panic| resume_unwind(panic)))
        });
        self.reporter.clear();
        let done = done?;
        if done.is_err() {
            self.check_stop()?;
        }
        done.map_err(|error| self.explain(error))
    }

    /// Fails if a signal such as Ctrl-C has requested the end of the verb.
    ///
    /// # Errors
    /// [`BoardError::Stopped`] with the signal.
    pub fn check_stop(&self) -> Result<(), BoardError> {
        match self.interrupt.signal() {
            None => Ok(()),
            Some(signal) => Err(BoardError::Stopped { signal, next: "the board is still open".into() }),
        }
    }
}
