//! The reports of the board for `ServerLink`, the link by which the TCP server itself uses its board.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};

use crate::link::ReadMeta;
use crate::sk::Frame;

/// How many unread reports are kept; the oldest are dropped. \[OURS]
const REPORTS_KEPT: usize = 32;

/// Reports that the TCP server itself has not read yet, while it is the writer and stops axes.
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

    pub(super) fn pop(&self, out: &mut Frame, limit: Duration) -> Option<ReadMeta> {
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
