//! A link that the server itself uses to stop the axes of a writer that has vanished.

use std::sync::Arc;
use std::time::Duration;

use super::board::Board;
use super::hub::Hub;
use super::report_queue::ReportQueue;
use crate::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::Frame;

/// A link with which the server itself uses its board. Closing it leaves the board open for the clients.
pub(super) struct ServerLink {
    pub(super) hub: Arc<Hub>,
    pub(super) board: Arc<Board>,
    /// The reports that the thread of the board reads; `None`: this link is used in that thread, and reads them itself.
    pub(super) queue: Option<Arc<ReportQueue>>,
}

impl ServerLink {
    /// Handles the loss of the board, if a call has failed because of it.
    fn noted<T>(&self, done: Result<T, LinkError>) -> Result<T, LinkError> {
        if let Err(error @ LinkError::Lost { .. }) = &done {
            self.hub.lose(&self.board, error);
        }
        done
    }
}

/// The longest wait in a call of this link: for a write without a limit of its own, and for every read in real time. So
/// the server never hangs on a board.
const WAIT_MAX: Duration = Duration::from_secs(10);

impl Link for ServerLink {
    fn info(&self) -> LinkInfo {
        LinkInfo { slot: self.board.size(), ..self.board.info.clone() }
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.check()?;
        let wait = if wait == Wait::Forever { Wait::For(WAIT_MAX) } else { wait };
        let done = self.board.write_own(frame, wait);
        self.board.now();
        self.noted(done)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.check()?;
        if self.board.info.virtual_time {
            let read = self.board.link.read(out, wait);
            self.board.now();
            let meta = self.noted(read)?;
            self.hub.publish(&self.board, out, meta);
            return Ok(meta);
        }
        let limit = wait.limit().unwrap_or(WAIT_MAX).min(WAIT_MAX);
        let timeout = LinkError::Timeout { dir: Dir::Read, waited: limit, what: "no report came" };
        let Some(queue) = &self.queue else {
            // When the server ends, it cancels reads, but waits until the axes stand. So a cancelled read is repeated.
            let read = match self.board.link.read(out, Wait::at_most(limit)) {
                Err(LinkError::Cancelled { .. }) => self.board.link.read(out, Wait::at_most(limit)),
                read => read,
            };
            let meta = self.noted(read)?;
            self.hub.publish(&self.board, out, meta);
            return Ok(meta);
        };
        queue.pop(out, limit).ok_or(timeout)
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        let done = self.board.link.pass(time);
        self.board.now();
        done
    }

    fn cancel(&self, _: Dir) {}

    fn close(&self) {}

    fn check(&self) -> Result<(), LinkError> {
        if self.hub.has(&self.board) {
            return Ok(());
        }
        Err(LinkError::Lost { name: self.board.info.name.clone(), reason: "it went away meanwhile".into() })
    }

    fn stats(&self) -> LinkStats {
        self.board.link.stats()
    }
}
