//! Sockets of links after a fork. The child has a copy of each socket, and the system closes a connection only with the last
//! copy: while the child keeps one, the server does not notice that the writer has ended. A child that executes another program
//! closes its copies then (`CLOEXEC`), so only children that do not are handled here.

use std::os::fd::RawFd;
use std::sync::atomic::{AtomicI32, Ordering};

/// The maximum number of links whose sockets are registered, so that forked children close their copies. \[OURS] If a writer
/// has more links and its children live on, the server notices the writer's end only after four keep-alive times.
const SOCKETS_MAX: usize = 64;
/// The value of an entry in which no socket is registered.
const FREE: RawFd = -1;

static SOCKETS: [AtomicI32; SOCKETS_MAX] = [const { AtomicI32::new(FREE) }; SOCKETS_MAX];

/// The registration of a link's socket, so that a forked child closes its copy of the socket. Dropping it unregisters the
/// socket, before the link closes it.
pub(super) struct LetGo {
    place: Option<usize>,
}

impl LetGo {
    pub(super) fn of(socket: RawFd) -> Self {
        let take =
            |place: &AtomicI32| place.compare_exchange(FREE, socket, Ordering::AcqRel, Ordering::Relaxed).is_ok();
        Self { place: SOCKETS.iter().position(take) }
    }
}

impl Drop for LetGo {
    fn drop(&mut self) {
        if let Some(place) = self.place {
            SOCKETS[place].store(FREE, Ordering::Release);
        }
    }
}

/// Closes this child's copies of the sockets of all links. It is made for a handler of `pthread_atfork`: it neither
/// locks nor allocates.
///
/// # Safety
/// The process is a child that was just forked, and it never uses or drops a link of its parent.
#[doc(hidden)]
pub unsafe fn close_in_child() {
    for place in &SOCKETS {
        let socket = place.swap(FREE, Ordering::AcqRel);
        if socket != FREE {
            // SAFETY: the parent's link owns this socket, and the caller promises that this child does not use its
            // copy.
            unsafe { rustix::io::close(socket) };
        }
    }
}
