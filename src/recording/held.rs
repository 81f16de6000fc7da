//! Frames on their way out of a capture: one to the board waits until the capture tells that it was taken.
//!
//! A capture has the bytes of a frame where the host hands it over. A program whose board takes nothing takes the frame
//! back after a while: that one never was at the board.

use std::collections::{HashMap, VecDeque};

use super::recorded::Recorded;

/// Frames that wait at most: a capture may lack the end of a transfer, and a reader of a pipe wants to see something.
/// \[OURS]
const MOST: usize = 4096;

#[derive(Default)]
pub(super) struct Held {
    frames: VecDeque<Waiting>,
    /// Frames that have left: the number of the first one here.
    left: u64,
    /// The number of the frame that waits for the end of a transfer.
    waiting: HashMap<u64, u64>,
}

struct Waiting {
    /// `None`: it was taken back.
    frame: Option<Recorded>,
    /// The transfer whose end is to be seen.
    until: Option<u64>,
}

impl Held {
    /// A frame; with the id of its transfer it waits for that one's end.
    pub fn push(&mut self, frame: Recorded, until: Option<u64>) {
        let number = self.left + self.frames.len() as u64;
        // The end of the transfer that had this id before is missing.
        if let Some(older) = until.and_then(|id| self.waiting.insert(id, number)) {
            self.frame(older).into_iter().for_each(|older| older.until = None);
        }
        self.frames.push_back(Waiting { frame: Some(frame), until });
    }

    /// A transfer has ended; `moved`: whether the board got its bytes. Says whether a frame goes for it.
    pub fn ended(&mut self, id: u64, moved: bool) -> bool {
        let Some(number) = self.waiting.remove(&id) else { return false };
        let Some(waiting) = self.frame(number) else { return false };
        waiting.until = None;
        if !moved {
            waiting.frame = None;
        }
        !moved
    }

    /// There is no more to see: what was handed over counts as taken.
    pub fn settle(&mut self) {
        self.waiting.clear();
        self.frames.iter_mut().for_each(|waiting| waiting.until = None);
    }

    /// The next frame in the order of the capture, unless one before it waits.
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
