//! The threads that this crate starts in a program that is not its own.

use std::io;
use std::thread::{Builder, JoinHandle};

/// Starts a thread that no signal of the program is delivered to: its handlers run in its own threads, and a signal that
/// it has blocked in all of them, to take it from a signalfd or by sigwait, finds none of ours to end the process in.
///
/// # Errors
/// The system's, if it gives no thread.
pub(crate) fn spawn<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> io::Result<JoinHandle<T>> {
    #[cfg(unix)]
    let _restored = Blocked::all()?;
    // A thread begins with the mask of the one that starts it.
    Builder::new().name(name.to_owned()).spawn(work)
}

/// Does something in this thread that may start threads of its own: no signal of the program is delivered to them either.
///
/// # Errors
/// The system's, if it does not say which signals are blocked; nothing was done then.
#[cfg(all(feature = "usb", unix))]
pub(crate) fn quietly<T>(work: impl FnOnce() -> T) -> io::Result<T> {
    let _restored = Blocked::all()?;
    Ok(work())
}

/// Signals blocked in this thread; as they were when it is dropped.
#[cfg(unix)]
struct Blocked {
    before: nix::sys::signal::SigSet,
}

#[cfg(unix)]
impl Blocked {
    fn all() -> io::Result<Self> {
        use nix::sys::signal::Signal::{SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, SIGSYS, SIGTRAP};
        use nix::sys::signal::{SigSet, SigmaskHow};

        let mut signals = SigSet::all();
        // A thread brings these on itself; blocked, they would end the process without its handler.
        [SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, SIGSYS, SIGTRAP].into_iter().for_each(|own| signals.remove(own));
        Ok(Self { before: signals.thread_swap_mask(SigmaskHow::SIG_BLOCK)? })
    }
}

#[cfg(unix)]
impl Drop for Blocked {
    fn drop(&mut self) {
        // A mask that was in force a moment ago is a valid one.
        let _ = self.before.thread_set_mask();
    }
}
