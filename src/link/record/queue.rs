//! The queue from the program's calls to the recorder's thread. On the real clock no call waits for room in it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use super::ring::{Ring, Taken};
use crate::recording::Clock;
use crate::threads::WaitQueue;

/// How often the recorder's thread checks an entry that is not finished, and how often the end of a recording checks
/// whether running calls and that thread have ended.
pub(super) const LOOK_INTERVAL: Duration = Duration::from_millis(1);
/// After this many checks of an unfinished entry, the thread that was adding it counts as ended by force. \[OURS]
const LOOKS_MAX: u32 = 200;
/// As [`LOOKS_MAX`], on a virtual clock. On a busy machine a thread may stall for long between two instructions. A long
/// wait for it loses nothing there, because calls wait for room. \[OURS]
const LOOKS_MAX_IN_VIRTUAL_TIME: u32 = 10_000;
/// The longest sleep of a thread that waits for the queue. A thread may be ended by force after it has added an entry
/// and before it has woken the recorder's thread; the entry then waits at most this long. \[OURS]
pub(super) const UNTOLD_MAX: Duration = Duration::from_millis(100);

/// The ring buffer of entries, and what its threads tell each other: that there is room, and that the recording has
/// ended.
pub(super) struct Queue<E> {
    pub(super) ring: Ring<E>,
    /// Signalled when the queue has room again.
    pub(super) room: WaitQueue,
    /// Whether the recording has ended, so that no more entries are added.
    pub(super) is_over: AtomicBool,
    /// The number of entries that are missing from the recording.
    pub(super) dropped: Arc<AtomicU64>,
    looks_max: u32,
}

impl<E> Queue<E> {
    /// Allocates a queue for `entries` entries of a link with the clock `clock`.
    pub fn new(entries: usize, clock: Clock, dropped: Arc<AtomicU64>) -> Self {
        let looks_max = if clock == Clock::Virtual { LOOKS_MAX_IN_VIRTUAL_TIME } else { LOOKS_MAX };
        let (ring, room) = (Ring::new(entries), WaitQueue::new());
        Self { ring, room, is_over: AtomicBool::new(false), dropped, looks_max }
    }

    /// Called by the recorder's thread: waits for entries and passes all of them to `push`. Returns whether the
    /// recording goes on.
    pub fn take_all(&self, mut push: impl FnMut(E)) -> bool {
        let (mut came, mut looks) = (false, 0);
        loop {
            // The flag is read before the ring: if it is set, no entry can come after those in the ring.
            let is_over = self.is_over.load(Ordering::SeqCst);
            match self.ring.take() {
                Taken::Entry(entry) => {
                    push(entry);
                    (came, looks) = (true, 0);
                }
                Taken::Unfinished if looks < self.looks_max => {
                    looks += 1;
                    std::thread::sleep(LOOK_INTERVAL);
                }
                Taken::Unfinished => {
                    self.ring.leave_out();
                    self.dropped.fetch_add(1, Ordering::Relaxed);
                    (came, looks) = (true, 0);
                }
                Taken::Nothing if came || is_over => {
                    self.room.notify_all();
                    return came || !is_over;
                }
                Taken::Nothing => std::thread::park_timeout(UNTOLD_MAX),
            }
        }
    }

    /// Ends the recording: no more entries are added.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::SeqCst);
        self.room.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On a virtual clock no entry is lost, however busy the machine is: if a thread stalls while it adds an entry, its
    /// place is kept, even for longer than on the real clock.
    #[test]
    fn a_late_thread_loses_nothing_in_virtual_time() {
        let queue = Queue::new(4, Clock::Virtual, Arc::default());
        let late = queue.ring.begin().expect("there is room");
        let mut taken = Vec::new();
        std::thread::scope(|scope| {
            let takes = scope.spawn(|| queue.take_all(|entry| taken.push(entry)));
            std::thread::sleep(LOOK_INTERVAL * LOOKS_MAX * 3);
            assert_eq!(queue.ring.store(late, 7), Ok(()));
            assert!(takes.join().expect("no panic"), "it goes on");
        });
        assert_eq!((taken, queue.dropped.load(Ordering::SeqCst)), (vec![7], 0));
    }
}
