//! Frames on their way out of a capture: one to the board waits until the capture tells that it was taken.
//!
//! A capture has the bytes of a frame where the host hands it over. A program whose board takes nothing takes the frame
//! back after a while: that one never was at the board.

use std::collections::VecDeque;

use super::reader::Recorded;

/// Frames that wait at most: a capture may lack the end of a transfer, and a reader of a pipe wants to see something.
/// \[OURS]
const MOST: usize = 4096;

#[derive(Default)]
pub(super) struct Held {
    frames: VecDeque<Waiting>,
}

struct Waiting {
    frame: Recorded,
    /// The transfer whose end is to be seen.
    until: Option<u64>,
}

impl Held {
    /// A frame; with the id of its transfer it waits for that one's end.
    pub fn push(&mut self, frame: Recorded, until: Option<u64>) {
        if let Some(id) = until {
            // The end of the transfer that had this id before is missing.
            self.waiting(id).into_iter().for_each(|older| older.until = None);
        }
        self.frames.push_back(Waiting { frame, until });
    }

    /// A transfer has ended; `moved`: whether the board got its bytes. Says whether a frame goes for it.
    pub fn ended(&mut self, id: u64, moved: bool) -> bool {
        let Some(i) = self.frames.iter().rposition(|waiting| waiting.until == Some(id)) else { return false };
        if moved {
            self.frames[i].until = None;
            return false;
        }
        self.frames.remove(i);
        true
    }

    /// There is no more to see: what was handed over counts as taken.
    pub fn settle(&mut self) {
        self.frames.iter_mut().for_each(|waiting| waiting.until = None);
    }

    /// The next frame in the order of the capture, unless one before it waits.
    pub fn pop(&mut self) -> Option<Recorded> {
        let first = self.frames.front()?;
        if first.until.is_some() && self.frames.len() <= MOST {
            return None;
        }
        self.frames.pop_front().map(|waiting| waiting.frame)
    }

    fn waiting(&mut self, id: u64) -> Option<&mut Waiting> {
        self.frames.iter_mut().rev().find(|waiting| waiting.until == Some(id))
    }
}
