//! The queue from the program's calls to the recorder's thread. On the real clock no call waits for room in it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use super::ring::{Ring, Taken};
use crate::threads::WaitQueue;

/// How often the recorder's thread checks an entry that is not finished, and how often the end of a recording checks
/// whether running calls and that thread have ended.
pub(super) const LOOK_INTERVAL: Duration = Duration::from_millis(1);
/// After this many checks of an unfinished entry, the thread that was adding it counts as ended by force. \[OURS]
const LOOKS_MAX: u32 = 200;
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
}

impl<E> Queue<E> {
    /// Allocates a queue for `entries` entries.
    pub fn new(entries: usize, dropped: Arc<AtomicU64>) -> Self {
        Self { ring: Ring::new(entries), room: WaitQueue::new(), is_over: AtomicBool::new(false), dropped }
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

    /// Ends the recording: no more entries are added.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::SeqCst);
        self.room.notify_all();
    }
}
