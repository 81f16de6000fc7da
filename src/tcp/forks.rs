//! The sockets of links in a child of fork. The child has a copy of each, and while it keeps one the server does not notice that the
//! writer has ended: the system closes a connection with the last copy. A program that is executed gets none (`CLOEXEC`).

use std::os::fd::RawFd;
use std::sync::atomic::{AtomicI32, Ordering};

/// How many links have a place here. \[OURS] The end of a writer with more, whose children live on, is noticed after four keep-alive
/// times.
const SOCKETS_MAX: usize = 64;
/// What a free place holds.
const FREE: RawFd = -1;

static SOCKETS: [AtomicI32; SOCKETS_MAX] = [const { AtomicI32::new(FREE) }; SOCKETS_MAX];

/// A socket that children let go of, until this is dropped: before the socket is closed.
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

/// Closes this child's copies of the sockets of all links. For a handler of `pthread_atfork`: it locks and allocates nothing.
///
/// # Safety
/// The process is a child that was just forked, and it never uses or drops a link of its parent.
#[doc(hidden)]
pub unsafe fn close_in_child() {
    for place in &SOCKETS {
        let socket = place.swap(FREE, Ordering::AcqRel);
        if socket != FREE {
            // SAFETY: the parent's link has this socket, and by the caller's promise its copy here is used by nobody.
            unsafe { rustix::io::close(socket) };
        }
    }
}
