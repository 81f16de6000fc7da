//! Finds out from `/proc` whether a thread is blocked in the kernel: in a call that this library does not replace, such
//! as a read from a pipe or a mutex.

use std::ffi::CString;

/// The state of a thread, as `/proc` shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The thread does not exist any more.
    Gone,
    /// The thread runs, or is about to run.
    Runs,
    /// The thread is blocked.
    Blocked {
        /// The number of its context switches. While it stays the same, the thread has not run.
        switches: u64,
    },
}

/// Looks up a thread of this process by its id in the kernel. `buffer` is reused for the content of the file in
/// `/proc`.
pub fn look(number: i32, buffer: &mut Vec<u8>) -> Task {
    let Ok(path) = CString::new(format!("/proc/self/task/{number}/status")) else { return Task::Runs };
    // SAFETY: the path ends with 0.
    let file = unsafe { libc::open(path.as_ptr(), libc::O_RDONLY | libc::O_CLOEXEC) };
    if file < 0 {
        return if crate::mode::errno() == libc::ENOENT { Task::Gone } else { Task::Runs };
    }
    let mut length = 0;
    loop {
        if buffer.len() == length {
            buffer.resize(length + 4096, 0);
        }
        let room = &mut buffer[length..];
        // SAFETY: the room has that many bytes, and the file was opened above.
        let got = unsafe { libc::read(file, room.as_mut_ptr().cast(), room.len()) };
        match usize::try_from(got) {
            // At the end of the file, or at an error, the text read so far is parsed.
            Ok(0) | Err(_) => break,
            Ok(got) => length += got,
        }
    }
    // SAFETY: opened above.
    unsafe { libc::close(file) };
    parse(&String::from_utf8_lossy(&buffer[..length]))
}

/// The CPU time that a thread of this process has used, in nanoseconds; 0 if the thread has not started.
pub fn processor_ns(number: i32) -> u64 {
    /// The low bits of a clock id that select the processor-time clock of a thread (the kernel's posix-timers.h).
    const OF_THREAD: i32 = 0b110;
    if number == 0 { 0 } else { crate::system::real_ns((!number << 3) | OF_THREAD) }
}

/// Parses the text of the file. If the text lacks a value, the thread counts as running.
fn parse(text: &str) -> Task {
    let value = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
    let number = |name: &str| value(name).and_then(|value| value.parse::<u64>().ok());
    match (value("State:"), number("voluntary_ctxt_switches:"), number("nonvoluntary_ctxt_switches:")) {
        // The thread is dead, and not removed from the list of threads yet.
        (Some(state), ..) if state.starts_with(['Z', 'X']) => Task::Gone,
        (Some(state), Some(own), Some(forced)) if state.starts_with('S') => Task::Blocked { switches: own + forced },
        _ => Task::Runs,
    }
}
