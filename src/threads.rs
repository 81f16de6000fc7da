//! Starts and ends the threads of this crate, which run inside programs of others. The modules `wait_queue.rs`, `sync.rs` and
//! `calling_thread.rs` are for the program's own threads, which wait in calls of this crate: a program may end such a thread by
//! force during its wait.

mod calling_thread;
#[cfg(all(unix, any(feature = "tcp", feature = "usb")))]
mod forks;
#[cfg(windows)]
mod owned_lock;
pub mod sync;
mod wait_queue;

use std::io;
use std::thread::{self, Builder, JoinHandle};
use std::time::{Duration, Instant};

pub use calling_thread::CallingThread;
#[cfg(all(unix, any(feature = "tcp", feature = "usb")))]
pub(crate) use forks::LetGo;
#[cfg(all(unix, any(feature = "tcp", feature = "usb")))]
pub use forks::close_in_child;
pub use wait_queue::{WaitQueue, WaitTicket};

/// How often [`end_within`] checks whether a thread has ended.
const CHECK_INTERVAL: Duration = Duration::from_millis(1);

/// Starts a thread with all signals blocked, except those for a fault of the thread itself, so that the program's signal
/// handlers run in the program's own threads. A program that receives a signal by signalfd or sigwait blocks it in all its
/// threads. If a thread of this crate did not block it, the system would deliver it there, and its default action would end
/// the process.
///
/// On Unix the thread has begun `work` when this function returns. Without memory for the guard page of its signal
/// stack a thread ends before it begins `work`, by a panic in the standard library, and a caller that waits for the
/// thread's work would wait forever.
///
/// # Errors
/// The system's error if it cannot create the thread, or out of memory if the thread cannot begin.
pub(crate) fn spawn<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> io::Result<JoinHandle<T>> {
    // The new thread inherits the mask of blocked signals.
    #[cfg(unix)]
    let _restored = SignalsBlocked::all()?;
    #[cfg(unix)]
    let (begun, begins) = std::sync::mpsc::sync_channel(1);
    let work = move || {
        #[cfg(unix)]
        let _ = begun.send(());
        work()
    };
    let thread = Builder::new().name(name.to_owned()).spawn(work)?;
    #[cfg(unix)]
    begins.recv().map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
    Ok(thread)
}

/// Sleeps. On Windows without a handle, which a thread of the program that is ended here would leave half closed.
#[cfg(feature = "usb")]
pub(crate) fn pause(time: Duration) {
    #[cfg(windows)]
    owned_lock::sleep(time.as_millis().try_into().unwrap_or(u32::MAX - 1));
    #[cfg(not(windows))]
    thread::sleep(time);
}

/// Waits for at most `limit` for the end of a thread that may hang in a system call; returns whether it has ended.
///
/// The program may unload this library next. If the thread hangs, the library is kept in memory until the process ends,
/// because the thread continues in the library's code when the system call returns.
pub(crate) fn end_within(thread: JoinHandle<()>, limit: Duration) -> bool {
    let began = Instant::now();
    while !thread.is_finished() {
        if began.elapsed() >= limit {
            keep_library_loaded();
            return false;
        }
        thread::sleep(CHECK_INTERVAL);
    }
    // The result would only say whether the thread has panicked; this function reports whether it has ended.
    let _ = thread.join();
    true
}

/// On systems other than Windows nothing unloads a shared library of this crate, so nothing has to be done.
#[cfg(not(windows))]
const fn keep_library_loaded() {}

#[cfg(windows)]
fn keep_library_loaded() {
    use std::ffi::c_void;
    use std::ptr::null_mut;

    /// `GET_MODULE_HANDLE_EX_FLAG_PIN | GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS`: keeps the module that contains an
    /// address loaded until the process ends.
    const PIN_BY_ADDRESS: u32 = 5;

    #[link(name = "kernel32")]
    unsafe extern "system" {
        fn GetModuleHandleExW(flags: u32, address: *const c_void, module: *mut *mut c_void) -> i32;
    }

    let mut module = null_mut();
    let here = keep_library_loaded as *const ();
    // SAFETY: the address is in this module; `module` receives the answer, which is not needed.
    unsafe { GetModuleHandleExW(PIN_BY_ADDRESS, here.cast(), &raw mut module) };
}

/// Runs `work` with all signals blocked, except those for a fault of the thread itself, so that threads which it starts
/// inherit the blocked signals.
///
/// # Errors
/// The system's error if the signals cannot be blocked. `work` is then not run.
#[cfg(all(feature = "usb", unix))]
pub(crate) fn with_signals_blocked<T>(work: impl FnOnce() -> T) -> io::Result<T> {
    let _restored = SignalsBlocked::all()?;
    Ok(work())
}

/// Blocks all signals, except those for a fault of the thread itself, in the thread that makes this value. Dropping the
/// value restores the thread's signal mask.
#[cfg(unix)]
struct SignalsBlocked {
    before: nix::sys::signal::SigSet,
}

#[cfg(unix)]
impl SignalsBlocked {
    fn all() -> io::Result<Self> {
        use nix::sys::signal::Signal::{SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, SIGSYS, SIGTRAP};
        use nix::sys::signal::{SigSet, SigmaskHow};

        let mut signals = SigSet::all();
        // The system raises these signals for a fault of the thread itself. If they were blocked, the process would end
        // without running its handler.
        [SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, SIGSYS, SIGTRAP].into_iter().for_each(|fault| signals.remove(fault));
        Ok(Self { before: signals.thread_swap_mask(SigmaskHow::SIG_BLOCK)? })
    }
}

#[cfg(unix)]
impl Drop for SignalsBlocked {
    fn drop(&mut self) {
        // The mask was valid when it was read, so restoring it cannot fail.
        let _ = self.before.thread_set_mask();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// WIN-9 `end_within` reports the end of a thread only after the thread's last instruction. It does not wait longer
    /// than its limit for a thread that hangs.
    #[test]
    fn a_thread_that_hangs_is_left() {
        let (goes_on, wait) = std::sync::mpsc::channel::<()>();
        let hangs = spawn("hangs", move || while wait.recv().is_ok() {}).expect("a thread");
        assert!(!end_within(hangs, Duration::from_millis(20)));
        drop(goes_on);
        let panics = spawn("panics", || panic!("this panic is part of the test")).expect("a thread");
        assert!(end_within(panics, Duration::from_secs(60)));
    }
}
