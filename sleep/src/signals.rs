//! Blocks the signals of the calling thread, and finds out whether a signal handler is due.

use libc::{c_int, sigset_t};

/// Signals that the kernel sends to a thread for a fault of the thread itself. They cannot be postponed.
const OF_OWN_DOING: [c_int; 6] = [libc::SIGSEGV, libc::SIGBUS, libc::SIGFPE, libc::SIGILL, libc::SIGTRAP, libc::SIGSYS];

/// The highest signal number.
const LAST: c_int = 64;

/// Until this is dropped, no signal handler runs in the thread, except for the signals [`OF_OWN_DOING`].
pub struct Blocked {
    before: sigset_t,
}

impl Blocked {
    pub fn begin() -> Self {
        let (mut all, mut before) = (empty(), empty());
        // SAFETY: both sets exist, and the signals are signals.
        unsafe {
            libc::sigfillset(&raw mut all);
            for signal in OF_OWN_DOING {
                libc::sigdelset(&raw mut all, signal);
            }
            libc::pthread_sigmask(libc::SIG_BLOCK, &raw const all, &raw mut before);
        }
        Self { before }
    }

    /// Whether a signal handler will run when this is dropped.
    pub fn is_handler_due(&self) -> bool {
        is_handler_due(&raw const self.before)
    }
}

impl Drop for Blocked {
    fn drop(&mut self) {
        // SAFETY: the set came from this thread, which the value does not leave.
        unsafe { libc::pthread_sigmask(libc::SIG_SETMASK, &raw const self.before, std::ptr::null_mut()) };
    }
}

/// Whether the thread would run a handler for a pending signal if it blocked only the signals of `mask`. With NULL, it
/// would run none.
pub fn is_handler_due(mask: *const sigset_t) -> bool {
    let mut pending = empty();
    // SAFETY: the set exists.
    if mask.is_null() || unsafe { libc::sigpending(&raw mut pending) } != 0 {
        return false;
    }
    (1..=LAST).any(|signal| {
        // SAFETY: both sets exist. Numbers that are no signals are in none.
        let is_let_in =
            unsafe { libc::sigismember(&raw const pending, signal) == 1 && libc::sigismember(mask, signal) == 0 };
        is_let_in && has_handler(signal)
    })
}

fn has_handler(signal: c_int) -> bool {
    // SAFETY: zeros are an action; the function fills it.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        libc::sigaction(signal, std::ptr::null(), &raw mut action) == 0
            && !matches!(action.sa_sigaction, libc::SIG_DFL | libc::SIG_IGN)
    }
}

const fn empty() -> sigset_t {
    // SAFETY: a set is an array of integers.
    unsafe { std::mem::zeroed() }
}
