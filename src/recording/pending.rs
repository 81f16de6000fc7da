//! Frames of a capture that are not returned to the reader yet: a frame to the board waits until the capture shows
//! whether the board has got it.
//!
//! A capture has the bytes of a frame where the host submits the transfer. If the board does not accept them, the
//! program cancels the transfer after a while, and the board never gets the frame.

use std::collections::{HashMap, VecDeque};

use super::recorded::Recorded;

/// The most frames that wait; beyond, the oldest one waits no longer and counts as taken by the board. A capture may
/// lack the end of a transfer, and the reader of a pipe must get its frames in time. \[OURS]
const MOST: usize = 4096;

#[derive(Default)]
pub(super) struct PendingFrames {
    frames: VecDeque<Waiting>,
    /// The number of frames that have left the queue. Frames are numbered in the order of the capture, so this is also
    /// the number of the first frame in `frames`.
    left: u64,
    /// For each transfer in flight, by its id: the number of the frame that waits for the end of the transfer.
    waiting: HashMap<u64, u64>,
}

struct Waiting {
    /// The frame; `None` if its transfer was cancelled.
    frame: Option<Recorded>,
    /// The id of the transfer whose end the frame waits for. `None`: the frame waits for none.
    until: Option<u64>,
}

impl PendingFrames {
    /// Adds a frame. If `until` is the id of its transfer, the frame waits for the end of the transfer.
    pub fn push(&mut self, frame: Recorded, until: Option<u64>) {
        let number = self.left + self.frames.len() as u64;
        // The id is in use again although the capture has no end of the earlier transfer. The earlier frame waits no
        // longer.
        if let Some(older) = until.and_then(|id| self.waiting.insert(id, number)) {
            self.frame(older).into_iter().for_each(|older| older.until = None);
        }
        self.frames.push_back(Waiting { frame: Some(frame), until });
    }

    /// Processes the end of a transfer; `moved`: whether the board got its bytes. If it did not, its frame is dropped,
    /// and the result is true.
    pub fn ended(&mut self, id: u64, moved: bool) -> bool {
        let Some(number) = self.waiting.remove(&id) else { return false };
        let Some(waiting) = self.frame(number) else { return false };
        waiting.until = None;
        if !moved {
            waiting.frame = None;
        }
        !moved
    }

    /// Ends all waits at the end of a capture: frames that were submitted count as taken.
    pub fn release(&mut self) {
        self.waiting.clear();
        self.frames.iter_mut().for_each(|waiting| waiting.until = None);
    }

    /// The next frame in the order of the capture; `None` while the first one waits.
    pub fn pop(&mut self) -> Option<Recorded> {
        loop {
            let first = self.frames.front()?;
            if first.until.is_some() && self.frames.len() <= MOST {
                return None;
            }
            let Waiting { frame, until } = self.frames.pop_front()?;
            if let Some(id) = until {
                self.waiting.remove(&id);
            }
            self.left += 1;
            if frame.is_some() {
                return frame;
            }
        }
    }

    fn frame(&mut self, number: u64) -> Option<&mut Waiting> {
        self.frames.get_mut(usize::try_from(number.checked_sub(self.left)?).ok()?)
    }
}
