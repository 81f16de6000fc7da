//! Descriptors of links after a fork. The child has a copy of each one, and the system closes a connection or releases a USB
//! device only with the last copy: while the child keeps one, the server does not notice that the writer has ended, and no other
//! program may have the USB board. A child that executes another program closes its copies then (`CLOEXEC`), so only
//! children that do not are handled here.

use std::os::fd::RawFd;
use std::sync::atomic::{AtomicI32, Ordering};

/// The maximum number of descriptors that are registered, so that forked children close their copies: one for a connection to a
/// server, some three for a USB board. \[OURS] If a writer has more links and its children live on, the server notices the
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

/// Closes this child's copies of the descriptors of all links. It is made for a handler of `pthread_atfork`: it neither
/// locks nor allocates.
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
