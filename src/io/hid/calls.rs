//! Helpers for the tests of a pipe: a read, and calls that must not take longer than a limit.

use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use super::{Pipe, PipeError, REPORT_LEN};

/// The time limit for a call in these tests, longer than any call takes: a call that exceeds it hangs.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// Reads the next report; returns its first byte and its number.
pub fn read(pipe: &Pipe, limit: Option<Duration>) -> Result<(u8, u64), PipeError> {
    let mut report = [0xA5; REPORT_LEN];
    let done = pipe.read(&mut report, limit);
    assert!(done.is_ok() || report == [0xA5; REPORT_LEN], "a read that fails leaves the report alone");
    done.map(|(_, number)| (report[0], number))
}

/// Runs `work` in a thread and panics if it does not end within [`PATIENCE`].
#[track_caller]
pub fn in_time<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    let (done, ended) = mpsc::channel();
    thread::spawn(move || done.send(work()));
    ended.recv_timeout(PATIENCE).expect("it does not end")
}

/// Runs `work` in a thread, and ends that thread by force, so that nothing of it is freed. `works_until` has to return
/// true once the thread is about to wait in `work`. The thread is ended 30 ms later, when it certainly waits there.
#[cfg(target_os = "linux")]
pub fn end_thread_in(work: impl FnOnce() + Send + 'static, mut works_until: impl FnMut() -> bool) {
    use std::os::unix::thread::JoinHandleExt as _;

    use crate::threads::CallingThread;

    extern "C" fn end_this_thread(_signal: libc::c_int) {
        // SAFETY: the call ends this thread and nothing else.
        unsafe { libc::syscall(libc::SYS_exit, 0) };
    }

    let (told, caller) = mpsc::channel();
    // SAFETY: the handler makes a call of the system alone, and no other test uses this signal.
    unsafe { libc::signal(libc::SIGUSR2, end_this_thread as extern "C" fn(libc::c_int) as libc::sighandler_t) };
    let thread = thread::spawn(move || {
        told.send(CallingThread::current()).expect("the test waits for it");
        work();
    });
    let caller = caller.recv().expect("it tells");
    while !works_until() {
        thread::sleep(Duration::from_millis(1));
    }
    thread::sleep(Duration::from_millis(30));
    // SAFETY: the thread is not joined, so its handle is valid; it waits in `work`.
    unsafe { libc::pthread_kill(thread.as_pthread_t(), libc::SIGUSR2) };
    while !caller.is_gone() {
        thread::sleep(Duration::from_millis(1));
    }
    // Joining the thread would wait for its result, which never comes.
    std::mem::forget(thread);
}
