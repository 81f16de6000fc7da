//! A link that the server itself uses to write to the board while there is no writer.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};

use super::hub::{Board, Hub};
use crate::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::Frame;

/// How many unread reports are kept. \[OURS]
const REPORTS_KEPT: usize = 32;

/// Reports for the server's own link.
pub(super) struct ReportQueue {
    reports: Mutex<VecDeque<(Frame, ReadMeta)>>,
    arrived: Condvar,
}

impl Default for ReportQueue {
    fn default() -> Self {
        Self { reports: Mutex::new(VecDeque::with_capacity(REPORTS_KEPT)), arrived: Condvar::new() }
    }
}

impl ReportQueue {
    pub(super) fn push(&self, frame: &Frame, meta: ReadMeta) {
        let mut reports = self.reports.lock();
        if reports.len() == REPORTS_KEPT {
            reports.pop_front();
        }
        reports.push_back((frame.clone(), meta));
        self.arrived.notify_one();
    }

    fn pop(&self, out: &mut Frame, limit: Duration) -> Option<ReadMeta> {
        let until = Instant::now() + limit;
        let mut reports = self.reports.lock();
        loop {
            if let Some((frame, meta)) = reports.pop_front() {
                out.clone_from(&frame);
                return Some(meta);
            }
            if self.arrived.wait_until(&mut reports, until).timed_out() && reports.is_empty() {
                return None;
            }
        }
    }
}

/// The server's own link. Closing it leaves the board open for the clients.
pub(super) struct ServerLink {
    pub(super) hub: Arc<Hub>,
    pub(super) board: Arc<Board>,
    pub(super) queue: Arc<ReportQueue>,
}

/// The longest wait of the server.
const WAIT_MAX: Duration = Duration::from_secs(10);

impl Link for ServerLink {
    fn info(&self) -> LinkInfo {
        self.board.info.clone()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.check()?;
        let wait = if wait == Wait::Forever { Wait::For(WAIT_MAX) } else { wait };
        let done = self.board.write(frame, wait);
        self.board.now();
        done
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.check()?;
        if self.board.info.virtual_time {
            let read = self.board.link.read(out, wait);
            self.board.now();
            let meta = read?;
            self.hub.publish(&self.board, out, meta);
            return Ok(meta);
        }
        let limit = wait.limit().unwrap_or(WAIT_MAX).min(WAIT_MAX);
        let timeout = LinkError::Timeout { dir: Dir::Read, waited: limit, what: "no report came" };
        self.queue.pop(out, limit).ok_or(timeout)
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
