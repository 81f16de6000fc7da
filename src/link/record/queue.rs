//! The queue to the recorder's thread, which no call on the real clock waits for.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use super::ring::{Ring, Taken};
use crate::threads::WaitQueue;

/// How often an entry is looked for that was begun, and the end of the recorder's thread.
pub(super) const LOOK_INTERVAL: Duration = Duration::from_millis(1);
/// After how many looks the thread that has begun an entry counts as one that was ended there. \[OURS]
const LOOKS_MAX: u32 = 200;
/// How long entries may lie there when the thread that would have told of them was ended just before. \[OURS]
pub(super) const UNTOLD_MAX: Duration = Duration::from_millis(100);

/// The queue, and what is told of it.
pub(super) struct Queue<E> {
    pub(super) ring: Ring<E>,
    /// There is room again.
    pub(super) room: WaitQueue,
    /// No entry is added any more.
    pub(super) is_over: AtomicBool,
    /// Entries that are missing from the recording.
    pub(super) dropped: Arc<AtomicU64>,
}

impl<E> Queue<E> {
    /// With room for so many entries.
    pub fn new(entries: usize, dropped: Arc<AtomicU64>) -> Self {
        Self { ring: Ring::new(entries), room: WaitQueue::new(), is_over: AtomicBool::new(false), dropped }
    }

    /// For the recorder's thread: waits for entries, gives all that are there to `push`, and says whether the recording goes on.
    pub fn take_all(&self, mut push: impl FnMut(E)) -> bool {
        let (mut came, mut looks) = (false, 0);
        loop {
            // Before the look at the queue, in which is all then.
            let is_over = self.is_over.load(Ordering::SeqCst);
            match self.ring.take() {
                Taken::Entry(entry) => {
                    push(entry);
                    (came, looks) = (true, 0);
                }
                Taken::Unfinished if looks < LOOKS_MAX => {
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

    /// Says that no entry is added any more.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::SeqCst);
        self.room.notify_all();
    }
}
