//! Outgoing frames: the frame that is composed next, and the time, number and mark by which the execution of the last
//! frame is recognised.

use super::slot_set::SlotSet;
use crate::link::Stamp;
use crate::sk::Frame;

/// Identifies a written frame, so that a call can tell when the board has executed it.
#[derive(Clone, Copy, Debug)]
pub struct Sent {
    /// When the frame was written.
    pub at: Stamp,
    /// The number of the frame among the FIFO entries since OP was reached, from 1; 0 outside OP.
    pub number: i64,
    /// The mark of the frame, a number by which reports show that the frame was executed ([`Marks`](super::marks::Marks)); 0 if
    /// it has none.
    pub mark: u8,
}

/// The next frame, and the identification of the last one.
pub struct Outgoing {
    /// The buffer of the next frame. After a write it holds the last frame until the next one is composed.
    pub frame: Frame,
    /// The mark of `frame`, by which reports show that it was executed; 0 if it has none.
    pub mark: u8,
    /// The number of frames written so far.
    pub written: u64,
    /// The identification of the last written frame. If that frame has no mark, `mark` is that of the last frame with a
    /// mark.
    pub last: Sent,
    /// The slots that had a command in the last frame with a mark.
    pub last_commanded: SlotSet,
}

impl Outgoing {
    pub const fn new() -> Self {
        Self {
            frame: Frame::new(),
            mark: 0,
            written: 0,
            last: Sent { at: Stamp(0), number: 0, mark: 0 },
            last_commanded: SlotSet::EMPTY,
        }
    }
}
