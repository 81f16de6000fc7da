//! A link around another link. It examines all frames, and passes problems in them and the counters of the board to a
//! [`SummaryWriter`], for the summary of `ecmsk exec`.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::watch::{FrameEvent, FrameWatch};
use super::writer::{Counted, SummaryWriter};
use super::{Line, of_frames, of_link};
use crate::engine::Counters;
use crate::link::{Layer, Link, LinkError, ReadMeta, Stamp, Wait};
use crate::sk::Frame;

/// A link around another link that examines frames and counters for the summary.
pub struct WatchLink {
    inner: Arc<dyn Link>,
    summary_writer: &'static SummaryWriter,
    /// The zero of the times of events, ns on the link's clock: the opening of the link, as in the log and in scripts.
    /// If a recorded program opens its board again, it is the first opening, as in the recording.
    zero_ns: i64,
    watch: Mutex<FrameWatch>,
    /// The board's counters when the link was opened. They are subtracted from later values, because a served board has counted
    /// for earlier programs too.
    before: Counters,
    closed: AtomicBool,
}

impl WatchLink {
    /// A watching link around `inner`, which was just opened.
    pub fn new(inner: Arc<dyn Link>, summary_writer: &'static SummaryWriter) -> Self {
        let (size, opened_ns) = (inner.info().slot.unwrap_or_default(), inner.info().opened_at.nanoseconds());
        let before_ns = i64::try_from(inner.recorded_before().as_nanos()).unwrap_or(i64::MAX);
        let zero_ns = opened_ns.saturating_sub(before_ns);
        let before = inner.stats().board.unwrap_or_default();
        let watch = Mutex::new(FrameWatch::new(size));
        Self { inner, summary_writer, zero_ns, watch, before, closed: AtomicBool::new(false) }
    }

    /// The time of an event, ns: from [`Self::zero_ns`] to `at`.
    fn time_ns(&self, at: Stamp) -> i64 {
        at.nanoseconds().saturating_sub(self.zero_ns)
    }

    fn tell_end(&self) {
        if !self.closed.swap(true, Ordering::AcqRel) {
            self.summary_writer.closed();
        }
    }

    /// Locks the frame watch. The lock is held only for a short time: while one frame is examined, or its counts are copied.
    fn watch(&self) -> MutexGuard<'_, FrameWatch> {
        self.watch.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Counted for WatchLink {
    fn counts(&self) -> Vec<(String, u64)> {
        let mut counts = of_link(&self.inner.stats(), &self.before);
        let frames = self.watch().counts();
        counts.extend(of_frames(&frames).map(|(name, value)| (name.to_owned(), value)));
        counts
    }

    fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Acquire)
    }
}

impl SummaryWriter {
    /// Wraps a link that was just opened: from now on this writer gets the problems in its frames, and its counters.
    pub fn watch(&'static self, inner: Arc<dyn Link>) -> Arc<dyn Link> {
        let link = Arc::new(WatchLink::new(inner, self));
        let counted: Arc<dyn Counted> = link.clone();
        self.add_board(Arc::downgrade(&counted));
        link
    }
}

impl Layer for WatchLink {
    fn inner(&self) -> &dyn Link {
        &*self.inner
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let at = self.inner.write(frame, wait)?;
        self.watch().command(self.time_ns(at), frame);
        Ok(at)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let meta = self.inner.read(out, wait)?;
        self.watch().report(self.time_ns(meta.at), out, &mut |event| {
            self.summary_writer.queue_line(match event {
                FrameEvent::Alarm(alarm) => Line::Alarm(alarm),
                FrameEvent::HeldBack(held) => Line::HeldBack(held),
                FrameEvent::StateFailed(failed) => Line::StateFailed(failed),
            });
        });
        Ok(meta)
    }

    fn close(&self) {
        // The link is closed before the file is written: closing may stop axes, and that must not wait for a disk.
        self.inner.close();
        self.tell_end();
    }

    fn vanish(&self) {
        self.inner.vanish();
        self.tell_end();
    }
}
