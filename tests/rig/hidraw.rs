//! A board through its hidraw node, moved as the vendor's library moves it: 513 bytes out, the first 0, 512 in.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use ecmsk::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use ecmsk::sk::{Frame, SlotSize};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::served::Board;

/// The report id in front of every output report: none.
const REPORT_ID: u8 = 0;

/// An open board.
pub struct Hidraw {
    file: File,
    name: String,
    opened: Instant,
    reports: AtomicU64,
    closed: AtomicBool,
}

impl Hidraw {
    #[track_caller]
    pub fn open(board: &Board) -> Self {
        let file = OpenOptions::new().read(true).write(true).open(&board.node).expect("root may open it");
        let name = board.node.display().to_string();
        let (reports, closed) = (AtomicU64::new(0), AtomicBool::new(false));
        Self { file, name, opened: Instant::now(), reports, closed }
    }

    /// Writes an output report; gives how many bytes were written, with the report id.
    pub fn put(&self, data: &[u8]) -> io::Result<usize> {
        let report = [&[REPORT_ID], data].concat();
        (&self.file).write(&report)
    }

    /// Waits for an input report; `None`: there was none.
    pub fn get(&self, limit: Duration) -> io::Result<Option<Vec<u8>>> {
        if !self.readable(Some(limit))? {
            return Ok(None);
        }
        // Room for more than a report.
        let mut bytes = vec![0xA5; 1024];
        let len = (&self.file).read(&mut bytes)?;
        bytes.truncate(len);
        Ok(Some(bytes))
    }

    fn readable(&self, limit: Option<Duration>) -> io::Result<bool> {
        let limit = limit.map(|limit| Timespec { tv_sec: limit.as_secs() as _, tv_nsec: limit.subsec_nanos() as _ });
        let mut fds = [PollFd::new(&self.file, PollFlags::IN)];
        Ok(poll(&mut fds, limit.as_ref())? > 0)
    }

    fn stamp(&self) -> Stamp {
        Stamp(self.opened.elapsed().as_nanos() as u64)
    }

    fn lost(&self, what: &'static str, error: io::Error) -> LinkError {
        LinkError::Io { what: format!("{what} {}", self.name), message: error.to_string() }
    }
}

impl Link for Hidraw {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: self.name.clone(),
            slot: Some(SlotSize::Bytes12),
            virtual_time: false,
            opened_at: Stamp(0),
            read_wait: Wait::Forever,
            write_wait: Wait::Forever,
        }
    }

    fn write(&self, frame: &Frame, _: Wait) -> Result<Stamp, LinkError> {
        match self.put(frame.bytes()) {
            Ok(513) => Ok(self.stamp()),
            Ok(other) => Err(self.lost("write", io::Error::other(format!("{other} bytes of 513")))),
            Err(error) => Err(self.lost("write", error)),
        }
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let limit = match wait {
            Wait::Now => Duration::ZERO,
            Wait::For(limit) => limit,
            Wait::Forever => super::served::PATIENCE,
        };
        if self.closed.load(Ordering::Acquire) {
            return Err(LinkError::Closed);
        }
        match self.get(limit) {
            Ok(Some(report)) => {
                assert_eq!(report.len(), 512, "a report has 512 bytes");
                out.set_prefix(&report);
                let sequence = self.reports.fetch_add(1, Ordering::Relaxed);
                Ok(ReadMeta { at: self.stamp(), sequence, dropped: 0 })
            }
            Ok(None) => Err(LinkError::Timeout { dir: Dir::Read, waited: limit, what: "no report came" }),
            Err(error) => Err(self.lost("read", error)),
        }
    }

    fn cancel(&self, _: Dir) {}

    fn close(&self) {
        self.closed.store(true, Ordering::Release);
    }

    fn check(&self) -> Result<(), LinkError> {
        if self.closed.load(Ordering::Acquire) { Err(LinkError::Closed) } else { Ok(()) }
    }

    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
}
