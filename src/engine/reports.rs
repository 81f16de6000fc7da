//! The queue of unread reports. If it is full, the oldest report is dropped and counted, as in the input queue of Windows' HID
//! driver (LIB-55).

use crate::fieldbus::Ns;
use crate::sk::Frame;

/// The time and the number of a report, which its reader gets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// When the report was made, in board time.
    pub at: Ns,
    /// The number of the report since the host interface was opened, counted from 0.
    pub sequence: u64,
    /// The number of reports that were dropped so far because they were not read in time.
    pub dropped: u64,
}

/// A ring buffer of unread reports, allocated once.
pub(super) struct ReportQueue {
    ring: Vec<(Frame, Ns)>,
    /// The sequence number of the oldest report that is kept.
    first: u64,
    len: usize,
    dropped: u64,
}

impl ReportQueue {
    pub(super) fn new(capacity: usize) -> Self {
        Self { ring: vec![(Frame::new(), 0); capacity.max(1)], first: 0, len: 0, dropped: 0 }
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The number of reports dropped so far, because they were not read in time.
    pub(super) const fn dropped(&self) -> u64 {
        self.dropped
    }

    pub(super) fn push(&mut self, frame: &Frame, at: Ns) {
        if self.len == self.ring.len() {
            self.first += 1;
            self.len -= 1;
            self.dropped += 1;
        }
        let place = self.place(self.first + self.len as u64);
        self.ring[place].0.clone_from(frame);
        self.ring[place].1 = at;
        self.len += 1;
    }

    /// Takes the oldest unread report.
    pub(super) fn pop(&mut self, out: &mut Frame) -> Option<Report> {
        if self.is_empty() {
            return None;
        }
        let place = self.place(self.first);
        let (frame, at) = &self.ring[place];
        out.clone_from(frame);
        let report = Report { at: *at, sequence: self.first, dropped: self.dropped };
        self.first += 1;
        self.len -= 1;
        Some(report)
    }

    fn place(&self, sequence: u64) -> usize {
        (sequence % self.ring.len() as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// LIB-55 The newest reports are kept, the oldest are dropped first, and each dropped one is counted. Sequence numbers
    /// count dropped reports, too.
    #[test]
    fn the_oldest_goes_first_and_is_counted() {
        let mut queue = ReportQueue::new(3);
        let (mut frame, mut out) = (Frame::new(), Frame::new());
        assert_eq!((queue.is_empty(), queue.pop(&mut out)), (true, None));
        for n in 0..8 {
            frame.bytes_mut()[0] = n;
            queue.push(&frame, n.into());
            assert_eq!(queue.dropped(), u64::from(n).saturating_sub(2));
        }
        for n in 5..8 {
            let report = Report { at: n, sequence: n, dropped: 5 };
            assert_eq!((queue.pop(&mut out), out.bytes()[0]), (Some(report), n as u8));
        }
        assert!(queue.is_empty());
        queue.push(&frame, 9);
        assert_eq!(queue.pop(&mut out), Some(Report { at: 9, sequence: 8, dropped: 5 }));
    }
}
