//! Calls of a pipe, as tests make them.

use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use super::{Pipe, PipeError, REPORT_LEN};

/// Longer than anything takes here.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// First byte and number of the next report.
pub fn read(pipe: &Pipe, limit: Option<Duration>) -> Result<(u8, u64), PipeError> {
    let mut report = [0xA5; REPORT_LEN];
    let done = pipe.read(&mut report, limit);
    assert!(done.is_ok() || report == [0xA5; REPORT_LEN], "a read that fails leaves the report alone");
    done.map(|(_, number)| (report[0], number))
}

/// Fails instead of waiting without end.
#[track_caller]
pub fn in_time<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    let (done, ended) = mpsc::channel();
    thread::spawn(move || done.send(work()));
    ended.recv_timeout(PATIENCE).expect("it does not end")
}
