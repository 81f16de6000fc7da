//! For tests of a pipe: reads, and calls that must end in time.

use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use super::{Pipe, PipeError, REPORT_LEN};

/// Longer than any call of these tests takes; a call that exceeds it has hung.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// Reads the next report; its first byte and its number.
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
