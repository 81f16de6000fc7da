//! Descriptors of links after a fork. The child has a copy of each descriptor, and the system closes a connection or
//! releases a USB device only when the last copy is closed. While the child keeps a copy, the server does not notice
//! that the writer has ended, and no other program can open the USB board. A child that executes another program then
//! closes its copies (`CLOEXEC`), so only children that execute no other program are handled here.

use std::os::fd::RawFd;
use std::sync::atomic::{AtomicI32, Ordering};

/// The maximum number of descriptors whose copies forked children close: one for each connection to a server, about
/// three for each USB board. \[OURS] If a writer has more links and its children live on, the server notices the
/// writer's end only after four keep-alive times.
const DESCRIPTORS_MAX: usize = 64;
/// The value of an entry in which no descriptor is registered.
const FREE: RawFd = -1;

static DESCRIPTORS: [AtomicI32; DESCRIPTORS_MAX] = [const { AtomicI32::new(FREE) }; DESCRIPTORS_MAX];

/// The registration of a link's descriptor, so that a forked child closes its copy. Dropping it unregisters the descriptor,
/// before the link closes it.
pub(crate) struct LetGo {
    place: Option<usize>,
}

impl LetGo {
    pub(crate) fn of(descriptor: RawFd) -> Self {
        let take =
            |place: &AtomicI32| place.compare_exchange(FREE, descriptor, Ordering::AcqRel, Ordering::Relaxed).is_ok();
        Self { place: DESCRIPTORS.iter().position(take) }
    }
}

impl Drop for LetGo {
    fn drop(&mut self) {
        if let Some(place) = self.place {
            DESCRIPTORS[place].store(FREE, Ordering::Release);
        }
    }
}

/// Closes this child's copies of the descriptors of all links. It neither locks nor allocates, so a handler of
/// `pthread_atfork` may call it.
///
/// # Safety
/// The process is a child that was just forked, and it never uses or drops a link of its parent.
#[doc(hidden)]
pub unsafe fn close_in_child() {
    for place in &DESCRIPTORS {
        let descriptor = place.swap(FREE, Ordering::AcqRel);
        if descriptor != FREE {
            // SAFETY: the parent's link owns this descriptor, and the caller promises that this child does not use its
            // copy.
            unsafe { rustix::io::close(descriptor) };
        }
    }
}
