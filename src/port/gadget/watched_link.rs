//! A wrapper of the board's link that derives the state of the network (slaves, axes, FIFO) from the frames and reports
//! that pass. The server needs this state to stop the axes of a vanished host. Closing the wrapper leaves the board
//! open, since the `Ecm` that stops the axes closes its link at the end.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;

use crate::ecm::Watch;
use crate::link::limits::taken;
use crate::link::{Dir, KnownNetwork, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::port::passing_frames::PassingFrames;
use crate::sk::Frame;

pub(super) struct WatchedLink {
    link: Arc<dyn Link>,
    passing: Mutex<PassingFrames>,
}

impl WatchedLink {
    pub(super) fn new(link: Arc<dyn Link>) -> Self {
        let passing = Mutex::new(PassingFrames::new(link.info().slot));
        Self { link, passing }
    }

    /// The wrapper for the new link of the same board, which was lost and opened again.
    pub(super) fn reopened(&self, link: Arc<dyn Link>) -> Self {
        let passing = Mutex::new(self.passing.lock().reopened(link.info().slot));
        Self { link, passing }
    }

    /// The state of the network that the frames and reports so far have shown.
    pub(super) fn watch(&self) -> Watch {
        self.passing.lock().watch().clone()
    }

    /// Closes the wrapped link, and so the board. [`Link::close`] of this link does nothing.
    pub(super) fn close_board(&self) {
        self.link.close();
    }
}

impl Link for WatchedLink {
    fn info(&self) -> LinkInfo {
        LinkInfo { slot: self.passing.lock().size(), ..self.link.info() }
    }

    fn network(&self) -> Option<KnownNetwork> {
        self.link.network()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let written = self.link.write(frame, wait);
        let mut passing = self.passing.lock();
        if let Some((frame, at)) = taken(frame, &written, || passing.size()) {
            passing.command(&frame, at);
        }
        written
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let meta = self.link.read(out, wait)?;
        self.passing.lock().report(out, meta);
        Ok(meta)
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        self.link.pass(time)
    }

    fn cancel(&self, dir: Dir) {
        self.link.cancel(dir);
    }

    fn close(&self) {}

    fn check(&self) -> Result<(), LinkError> {
        self.link.check()
    }

    fn stats(&self) -> LinkStats {
        self.link.stats()
    }
}
