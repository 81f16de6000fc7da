//! Counters of a program's reads and writes on a link, for [`LinkStats`].

use std::sync::atomic::{AtomicU64, Ordering};

use super::{LinkError, LinkStats};

/// The numbers of successful and failed reads and writes of a link.
#[derive(Default)]
pub(crate) struct CallCounts {
    written: AtomicU64,
    read: AtomicU64,
    write_errors: AtomicU64,
    read_errors: AtomicU64,
}

impl CallCounts {
    /// Counts a write and returns its result.
    pub(crate) fn write<T>(&self, done: Result<T, LinkError>) -> Result<T, LinkError> {
        counted(done, &self.written, &self.write_errors)
    }

    /// Counts a read and returns its result.
    pub(crate) fn read<T>(&self, done: Result<T, LinkError>) -> Result<T, LinkError> {
        counted(done, &self.read, &self.read_errors)
    }

    /// The number of reads and writes that have ended so far, with or without success.
    pub(crate) fn ended(&self) -> u64 {
        let LinkStats { written, read, write_errors, read_errors, .. } = self.stats();
        written + read + write_errors + read_errors
    }

    /// A [`LinkStats`] with the numbers of successful and failed reads and writes; all other counters are 0.
    pub(crate) fn stats(&self) -> LinkStats {
        let count = |count: &AtomicU64| count.load(Ordering::Relaxed);
        LinkStats {
            written: count(&self.written),
            read: count(&self.read),
            write_errors: count(&self.write_errors),
            read_errors: count(&self.read_errors),
            ..LinkStats::default()
        }
    }
}

fn counted<T>(done: Result<T, LinkError>, good: &AtomicU64, bad: &AtomicU64) -> Result<T, LinkError> {
    let count = if done.is_ok() { good } else { bad };
    count.fetch_add(1, Ordering::Relaxed);
    done
}
