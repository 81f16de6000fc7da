//! Distinguishable frames, by which a host watches the command FIFO.

use ecmsk::fieldbus::Ns;
use ecmsk::sk::{Frame, Motion, SlaveCommand};

use crate::host::Host;

/// The slave whose slot the marked frames use.
pub const MARKED: usize = 1;

impl Host {
    /// Lets a frame arrive now; no time passes.
    pub fn arrive(&mut self, frame: &Frame) -> &mut Self {
        let now = self.board.now();
        self.board.host(frame, now, &mut |_, _| panic!("no cycle is due"));
        self
    }

    /// A frame with a CSP for slave 1 whose index is `mark`: the index comes back once the frame has been executed.
    pub fn marked(&self, mark: u8) -> Frame {
        let mut frame = Frame::new();
        let csp = SlaveCommand::Csp(Motion::to(i32::from(mark))).with_index(mark);
        frame.put_slave(self.size, MARKED, &csp);
        frame
    }

    /// Lets `marks.len()` such frames arrive now.
    pub fn arrive_marked(&mut self, marks: impl IntoIterator<Item = u8>) -> &mut Self {
        for mark in marks {
            let frame = self.marked(mark);
            self.arrive(&frame);
        }
        self
    }

    /// The mark of the frame executed last.
    pub fn mark_shown(&self) -> u8 {
        self.drive(MARKED).head.index
    }

    /// Free entries and full count.
    pub fn fifo(&self) -> (u16, u16) {
        (self.answer().fifo_free, self.answer().full_count)
    }

    /// Board time of the newest report.
    pub fn time(&self) -> Ns {
        self.board.now()
    }
}
