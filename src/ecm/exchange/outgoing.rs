//! The frames that go out: the next one, and what has to be known of the last one.

use super::slot_set::SlotSet;
use crate::link::Stamp;
use crate::sk::Frame;

/// By what a frame that was written is known again.
#[derive(Clone, Copy, Debug)]
pub struct Sent {
    /// When it was written.
    pub at: Stamp,
    /// Its number among the entries of the FIFO since OP was reached, from 1; 0 outside OP.
    pub number: i64,
    /// Its mark ([`Marks`](super::marks::Marks)); 0 if it has none.
    pub mark: u8,
}

/// The next frame and the last one.
pub struct Outgoing {
    /// The next frame, or the last one, after it was written.
    pub frame: Frame,
    /// The mark of that frame; 0 if it has none.
    pub mark: u8,
    /// Frames written so far.
    pub written: u64,
    /// The last frame that was written. Its mark is that of the last frame that had one.
    pub last: Sent,
    /// Slots that had a command in the last frame that had a mark.
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
