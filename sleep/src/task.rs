//! Whether a thread is blocked in the kernel: in a call that this library does not stand in front of, such as a read from a
//! pipe or a mutex.

use std::ffi::CString;

/// What `/proc` says of a thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// There is no such thread any more.
    Gone,
    /// It runs, or is about to.
    Runs,
    /// It is blocked, and has been on and off the processor that often since it began.
    Blocked {
        /// The number of its context switches. While it stays the same, the thread has not run.
        switches: u64,
    },
}

/// Looks up a thread of this process by the kernel's number. `buffer` is room for a file of `/proc`.
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
            // The end of the file; what an error has left unread is not said.
            Ok(0) | Err(_) => break,
            Ok(got) => length += got,
        }
    }
    // SAFETY: opened above.
    unsafe { libc::close(file) };
    parse(&String::from_utf8_lossy(&buffer[..length]))
}

/// The time of the processor that a thread of this process has used, in nanoseconds; 0 for one that has not begun.
pub fn processor_ns(number: i32) -> u64 {
    /// A thread's clock of all that it uses, in the low bits of a clock's number (the kernel's posix-timers.h).
    const OF_THREAD: i32 = 0b110;
    if number == 0 { 0 } else { crate::system::real_ns((!number << 3) | OF_THREAD) }
}

/// Reads the file's text. What it does not say is taken for a thread that runs.
fn parse(text: &str) -> Task {
    let value = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
    let number = |name: &str| value(name).and_then(|value| value.parse::<u64>().ok());
    match (value("State:"), number("voluntary_ctxt_switches:"), number("nonvoluntary_ctxt_switches:")) {
        // Dead, and not yet taken off the list.
        (Some(state), ..) if state.starts_with(['Z', 'X']) => Task::Gone,
        (Some(state), Some(own), Some(forced)) if state.starts_with('S') => Task::Blocked { switches: own + forced },
        _ => Task::Runs,
    }
}
