//! The queue to the recorder's thread. No call on the real clock waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use super::ring::{Ring, Taken};
use crate::threads::WaitQueue;

/// The interval for checking an unfinished entry, and the end of the recorder's thread.
pub(super) const LOOK_INTERVAL: Duration = Duration::from_millis(1);
/// After how many checks of an unfinished entry its thread counts as ended by force. \[OURS]
const LOOKS_MAX: u32 = 200;
/// How long entries may wait unnoticed if the thread that added them was ended before it woke the recorder's thread.
/// \[OURS]
pub(super) const UNTOLD_MAX: Duration = Duration::from_millis(100);

/// The ring buffer of entries, and the signals around it.
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

    /// For the recorder's thread: waits for entries and passes all of them to `push`. Returns whether the recording
    /// goes on.
    pub fn take_all(&self, mut push: impl FnMut(E)) -> bool {
        let (mut came, mut looks) = (false, 0);
        loop {
            // Read before the ring: if it is true, the ring already has all entries.
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
