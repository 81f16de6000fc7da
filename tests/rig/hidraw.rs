//! A board through its hidraw node, moved as the vendor's library moves it: 513 bytes out, the first 0, 512 in.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use support::served::Board;

/// The report id in front of every output report: none.
const REPORT_ID: u8 = 0;

/// An open board.
pub struct Hidraw {
    file: File,
}

impl Hidraw {
    #[track_caller]
    pub fn open(board: &Board) -> Self {
        Self { file: OpenOptions::new().read(true).write(true).open(&board.node).expect("root may open it") }
    }

    /// Writes an output report; returns how many bytes were written, including the report id.
    pub fn put(&self, data: &[u8]) -> io::Result<usize> {
        let report = [&[REPORT_ID], data].concat();
        (&self.file).write(&report)
    }

    /// Waits for an input report; `None`: none came.
    pub fn get(&self, limit: Duration) -> io::Result<Option<Vec<u8>>> {
        let limit = Timespec { tv_sec: limit.as_secs() as _, tv_nsec: limit.subsec_nanos() as _ };
        let mut fds = [PollFd::new(&self.file, PollFlags::IN)];
        if poll(&mut fds, Some(&limit))? == 0 {
            return Ok(None);
        }
        // Room for more than a report.
        let mut bytes = vec![0xA5; 1024];
        let len = (&self.file).read(&mut bytes)?;
        bytes.truncate(len);
        Ok(Some(bytes))
    }
}
