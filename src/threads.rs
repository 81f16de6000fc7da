//! The threads that this crate starts in a program that is not its own.

use std::io;
use std::thread::{self, Builder, JoinHandle};
use std::time::{Duration, Instant};

/// How often is looked whether a thread has ended.
const LOOK_EVERY: Duration = Duration::from_millis(1);

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

/// Waits for the end of a thread that may hang in the system, but not for longer than that; whether it has ended.
///
/// A program may unload this library next. One that hangs keeps it in memory as long as the process lives: its code must be
/// there when the system lets it go.
pub(crate) fn end_within(thread: JoinHandle<()>, limit: Duration) -> bool {
    let began = Instant::now();
    while !thread.is_finished() {
        if began.elapsed() >= limit {
            stay_for_good();
            return false;
        }
        thread::sleep(LOOK_EVERY);
    }
    // That it panicked cannot be told to anybody here.
    let _ = thread.join();
    true
}

/// No shared library of this crate is unloaded here.
#[cfg(not(windows))]
const fn stay_for_good() {}

#[cfg(windows)]
fn stay_for_good() {
    use std::ffi::c_void;
    use std::ptr::null_mut;

    /// `GET_MODULE_HANDLE_EX_FLAG_PIN | GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS`
    const PIN_BY_ADDRESS: u32 = 5;

    #[link(name = "kernel32")]
    unsafe extern "system" {
        fn GetModuleHandleExW(flags: u32, address: *const c_void, module: *mut *mut c_void) -> i32;
    }

    let mut module = null_mut();
    let here = stay_for_good as *const ();
    // SAFETY: the address is one of this module; `module` has room for the answer, which is of no interest.
    unsafe { GetModuleHandleExW(PIN_BY_ADDRESS, here.cast(), &raw mut module) };
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

#[cfg(test)]
mod tests {
    use super::*;

    /// WIN-9 A thread has ended when that is said, to its last instruction; one that hangs is not waited for.
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
