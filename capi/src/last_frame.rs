//! The frame that was transferred last, in either direction.
//!
//! The vendor's library has one static buffer for both directions, and a read copies it to the caller, even if the read
//! has failed. So a program that looks at the state byte or at the CRC, and not at the result, sees its own last command
//! after its board is gone, and not forever the last state of a machine that is no longer there.
//!
//! A thread may be ended by force while it copies a frame. No other thread waits for it then: only the place that it
//! was writing to is no longer used, and there are further places.

use std::sync::atomic::{AtomicU64, Ordering, fence};

use ecmsk::sk::{FRAME_LEN, Frame};

/// The number of places in memory in which a frame can be kept. There should be more of them than threads that write or read
/// frames at the same moment: a frame that finds no free place is not kept. \[OURS]
const PLACES: usize = 8;
/// How many times a frame is copied at most, if another thread replaces it during the copy. After that the result is a
/// frame of zeros. \[OURS]
const TRIES: usize = 100;
/// The [`Place::number`] of a place that a thread is writing to, or was writing to when it was ended by force.
const WRITING: u64 = u64::MAX;
const WORD: usize = size_of::<u64>();
const WORDS: usize = FRAME_LEN / WORD;

/// The newest frames, each with the serial number under which it was kept. The frame with the greatest number is the
/// newest one.
pub struct LastFrame {
    places: [Place; PLACES],
    numbers: AtomicU64,
}

struct Place {
    /// The serial number of the frame in this place, from 1; 0 if the place is empty.
    number: AtomicU64,
    words: [AtomicU64; WORDS],
}

impl Place {
    const fn new() -> Self {
        Self { number: AtomicU64::new(0), words: [const { AtomicU64::new(0) }; WORDS] }
    }
}

/// The frame that [`ECMUSBWrite`](crate::exported::vendor::ECMUSBWrite) or
/// [`ECMUSBRead`](crate::exported::vendor::ECMUSBRead) has transferred last. All threads share it, as with the vendor's
/// library, and it stays when the board is closed.
pub static LAST_FRAME: LastFrame = LastFrame::new();

impl LastFrame {
    /// A value without a frame: [`Self::get`] returns a frame of zeros, as the vendor's buffer is before the first
    /// call. \[OURS]
    pub const fn new() -> Self {
        Self { places: [const { Place::new() }; PLACES], numbers: AtomicU64::new(0) }
    }

    /// Keeps a frame that was just written or read, as the one that [`Self::get`] returns.
    pub fn keep(&self, frame: &Frame) {
        let number = self.numbers.fetch_add(1, Ordering::Relaxed) + 1;
        // The search for a place begins after the place of the previous frame, which so stays unchanged for threads that are
        // reading it.
        let from = (number % PLACES as u64) as usize;
        for place in self.places[from..].iter().chain(&self.places[..from]) {
            if place.number.swap(WRITING, Ordering::Acquire) == WRITING {
                continue;
            }
            fence(Ordering::Release);
            for (word, bytes) in place.words.iter().zip(frame.bytes().as_chunks::<WORD>().0) {
                word.store(u64::from_ne_bytes(*bytes), Ordering::Relaxed);
            }
            place.number.store(number, Ordering::Release);
            return;
        }
        // Other threads are writing to all places at this moment, so this frame is not kept: a frame of another thread
        // becomes the last one.
    }

    /// The frame that was kept last.
    pub fn get(&self) -> Frame {
        let mut frame = Frame::new();
        for _ in 0..TRIES {
            let numbered = |place: &Place| {
                let number = place.number.load(Ordering::Acquire);
                if number == WRITING { 0 } else { number }
            };
            let Some((place, number)) = self.places.iter().map(|place| (place, numbered(place))).max_by_key(|of| of.1)
            else {
                break;
            };
            for (word, bytes) in place.words.iter().zip(frame.bytes_mut().as_chunks_mut::<WORD>().0) {
                *bytes = word.load(Ordering::Relaxed).to_ne_bytes();
            }
            fence(Ordering::Acquire);
            if place.number.load(Ordering::Relaxed) == number {
                return frame;
            }
        }
        // Other threads replace frames faster than this thread copies one: an empty frame is better than parts of two.
        Frame::new()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;
    use std::thread;

    use super::*;

    fn filled(with: u8) -> Frame {
        Frame::from_bytes([with; FRAME_LEN])
    }

    /// LIB-54 Before any frame was kept the last frame is all 0; afterwards it is the one that was kept last.
    #[test]
    fn the_last_frame_is_kept() {
        let last = LastFrame::new();
        assert_eq!(last.get(), Frame::new());
        for with in 1..=100 {
            last.keep(&filled(with));
            assert_eq!(last.get(), filled(with));
        }
    }

    /// LIB-54 However many threads keep frames at the same time, a reader gets one whole frame and not parts of two.
    #[test]
    fn no_frame_is_of_two() {
        let (last, ended) = (LastFrame::new(), AtomicBool::new(false));
        thread::scope(|scope| {
            for with in 1..=3_u8 {
                let (last, ended) = (&last, &ended);
                scope.spawn(move || {
                    for n in (0..60).cycle() {
                        last.keep(&filled(with + 4 * n));
                        if ended.load(Ordering::Relaxed) {
                            break;
                        }
                    }
                });
            }
            for _ in 0..20_000 {
                let frame = last.get();
                assert!(frame.bytes().iter().all(|byte| *byte == frame.bytes()[0]), "{:?}", frame.bytes());
            }
            ended.store(true, Ordering::Relaxed);
        });
    }

    /// LIB-70 If a thread is ended while it keeps a frame, only that frame is lost.
    #[test]
    fn a_thread_that_was_ended_holds_nothing() {
        let last = LastFrame::new();
        for with in 1..=PLACES as u8 {
            last.keep(&filled(with));
            // A thread that was ended by force in the middle of a frame leaves its place marked as being written to.
            let newest = last.places.iter().max_by_key(|place| place.number.load(Ordering::Relaxed)).unwrap();
            if with < PLACES as u8 {
                let other = last
                    .places
                    .iter()
                    .find(|place| !std::ptr::eq(*place, newest) && place.number.load(Ordering::Relaxed) != WRITING);
                other.unwrap().number.store(WRITING, Ordering::Relaxed);
            }
            assert_eq!(last.get(), filled(with));
        }
    }
}
