//! Fault injection: a [`Link`] around any link that loses, corrupts, duplicates and delays frames and disconnects the
//! board, so that the error handling of a program can be tested without pulling a cable.
//!
//! ```
//! use ecmsk::link::{self, LinkError, Share, Wait};
//! use ecmsk::sk::Frame;
//!
//! let board = link::open("sim:?clock=virtual&fault.drop.read=0.1&fault.disconnect_after=100", Share::ByName)?;
//! let mut report = Frame::new();
//! let lost = loop {
//!     if let Err(error) = board.read(&mut report, Wait::Forever) {
//!         break error;
//!     }
//! };
//! assert!(matches!(lost, LinkError::Lost { .. }), "{lost}");
//! assert_eq!(board.stats().read, 100);
//! assert!(board.stats().faults.read.dropped > 0);
//! # Ok::<(), LinkError>(())
//! ```
//!
//! The seed determines which frame gets which fault, separately for each direction: a program with one calling thread
//! on a virtual clock sees the same faults in every run. Every fault is counted in [`LinkStats::faults`] and logged. A
//! recording wraps the fault injection, so it has the frames as the program saw them, which may differ from those of
//! the board.
//!
//! \[OURS] What a program sees of each fault:
//! - *drop*: a write succeeds and the board gets nothing; a report never arrives and leaves a gap in the sequence
//!   numbers.
//! - *corrupt*: one bit of a frame is flipped, anywhere in its slots.
//! - *duplicate*: the board takes a frame twice; a report is read twice, with the same sequence number.
//! - *delay*: a write takes longer by the delay, or reaches its time limit, in which case the frame was not taken. A
//!   report and all reports after it arrive later. A read whose time limit passes before that fails, and a later read
//!   gets them. Reports keep their order.
//! - *disconnect*: every call fails with [`LinkError::Lost`] and every wait ends with it, until the link is opened
//!   again. `fault.disconnect_after` is the number of calls that succeed before. `fault.disconnect_ms` counts in real
//!   time, or on a virtual clock in the board's time.

mod clock;
mod options;
mod random;
mod stats;

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

pub use options::{FaultOptions, FaultRates};
pub use stats::{FaultCounts, FaultStats};

use super::{Dir, Layer, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::address::Fraction;
use crate::sk::{Frame, SlotSize};
use crate::span::Seconds;
use crate::threads::sync::unlockable::Mutex;
use clock::{Call, Clock, POLL_TIME};
use random::FaultSequence;
use stats::{Counters, count, read};

/// The number of queued reports for which memory is allocated when the link is opened. If fewer than two places are
/// free, a report is not duplicated. Each reading thread queues at most two: a report and its duplicate.
const PENDING_MAX: usize = 64;

/// A report that was read from the inner link and is not yet due.
struct PendingReport {
    frame: Frame,
    meta: ReadMeta,
    /// When the program may get the report, as time since the link was opened.
    due: Duration,
}

/// A link around another one, which injects faults into its frames.
pub struct FaultLink {
    inner: Arc<dyn Link>,
    info: LinkInfo,
    options: FaultOptions,
    clock: Clock,
    sequences: [Mutex<FaultSequence>; 2],
    pending: Mutex<VecDeque<PendingReport>>,
    writes: Counters,
    reads: Counters,
    /// The key that caused the disconnection; empty while the board is connected.
    disconnected: OnceLock<&'static str>,
    /// Whether the program has closed the link.
    closed: AtomicBool,
}

impl FaultLink {
    /// A link that passes frames on to `inner` and injects faults.
    pub fn new(inner: Arc<dyn Link>, options: FaultOptions) -> Self {
        let info = inner.info();
        let bits = info.slot.unwrap_or(SlotSize::Bytes12).frame_len() * 8;
        let sequence = |dir, rates| Mutex::new(FaultSequence::new(options.seed, dir, rates, bits));
        Self {
            clock: Clock::new(Arc::clone(&inner), &info),
            inner,
            info,
            options,
            sequences: [sequence(Dir::Write, options.write), sequence(Dir::Read, options.read)],
            pending: Mutex::new(VecDeque::with_capacity(PENDING_MAX)),
            writes: Counters::default(),
            reads: Counters::default(),
            disconnected: OnceLock::new(),
            closed: AtomicBool::new(false),
        }
    }

    /// Counts a call, and disconnects the board once `fault.disconnect_after` calls have succeeded.
    fn finish<T>(&self, counters: &Counters, done: Result<T, LinkError>) -> Result<T, LinkError> {
        match done {
            Ok(done) => {
                count(&counters.done);
                let frames = read(&self.writes.done) + read(&self.reads.done);
                if self.options.disconnect_after.is_some_and(|limit| frames >= limit) {
                    self.disconnect("fault.disconnect_after");
                }
                Ok(done)
            }
            Err(error) => {
                count(&counters.failed);
                Err(self.lost_error().unwrap_or(error))
            }
        }
    }

    /// Disconnects the board: closes the inner link, which ends every wait.
    fn disconnect(&self, key: &'static str) {
        if self.disconnected.set(key).is_ok() {
            log::warn!("fault: `{}` is disconnected ({key})", self.info.name);
            self.clock.close();
            self.inner.close();
        }
    }

    /// The error of a disconnected board; `None` if it is connected or the program has closed the link.
    fn lost_error(&self) -> Option<LinkError> {
        let reason = *self.disconnected.get()?;
        let closed = self.closed.load(Ordering::Acquire);
        (!closed).then(|| LinkError::Lost { name: self.info.name.clone(), reason: reason.into() })
    }

    /// Fails if the board is disconnected. Disconnects it if `fault.disconnect_ms` has passed.
    fn check_connected(&self) -> Result<(), LinkError> {
        if let Some(lost) = self.lost_error() {
            return Err(lost);
        }
        if let Some(limit) = self.options.disconnect_at
            && self.clock.now()? >= limit
        {
            self.disconnect("fault.disconnect_ms");
        }
        self.lost_error().map_or(Ok(()), Err)
    }

    fn write_frame(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.check_connected()?;
        let call = self.clock.call(Dir::Write, wait)?;
        let faults = self.sequences[0].lock().next_frame();
        let until = self.options.disconnect_at;
        if faults.delay {
            count(&self.writes.delayed);
            log::info!("fault: a command frame is held up for {:?}", self.options.delay);
            let due = self.clock.now()? + self.options.delay;
            let is_due = self.clock.wait_until(&call, until.map_or(due, |until| due.min(until)))?;
            self.check_connected()?;
            if !is_due {
                return Err(timeout(Dir::Write, wait, "the frame is held up (fault.delay)"));
            }
        }
        if faults.drop {
            count(&self.writes.dropped);
            // A dropped frame still takes its transfer time, so a virtual clock advances.
            self.inner.pass(POLL_TIME)?;
            let at = self.clock.stamp(self.clock.now()?);
            log::info!("fault: a command frame is dropped at {}", self.since_opened(at));
            return Ok(at);
        }
        let corrupted = faults.corrupt.map(|bit| {
            count(&self.writes.corrupted);
            log::info!("fault: bit {} of byte {} of a command frame is flipped", bit % 8, bit / 8);
            flip_bit(frame, bit)
        });
        let frame = corrupted.as_ref().unwrap_or(frame);
        let left = if faults.delay || until.is_some() { self.clock.remaining(&call, until)? } else { wait };
        let at = match self.inner.write(frame, left) {
            Err(LinkError::Timeout { .. }) => {
                self.check_connected()?;
                return Err(LinkError::timed_out(Dir::Write, wait));
            }
            done => done?,
        };
        if faults.duplicate && self.inner.write(frame, self.clock.remaining(&call, until)?).is_ok() {
            count(&self.writes.duplicated);
            log::info!("fault: the command frame of {} arrives twice", self.since_opened(at));
        }
        Ok(at)
    }

    /// A time stamp as messages show it: the time since the link was opened.
    fn since_opened(&self, at: Stamp) -> Seconds {
        Seconds(at.0.saturating_sub(self.inner.info().opened_at.0))
    }

    fn read_report(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.check_connected()?;
        let call = self.clock.call(Dir::Read, wait)?;
        let begin = self.clock.now()?;
        let mut frame = Frame::new();
        loop {
            self.clock.check(&call)?;
            if let Some(meta) = self.take_pending(&call, wait, out)? {
                return Ok(meta);
            }
            let left = self.clock.remaining(&call, self.options.disconnect_at)?;
            let meta = match self.inner.read(&mut frame, left) {
                Err(LinkError::Timeout { .. }) => {
                    self.check_connected()?;
                    return Err(LinkError::timed_out(Dir::Read, wait));
                }
                done => done?,
            };
            self.check_connected()?;
            let faults = self.sequences[1].lock().next_frame();
            if faults.drop {
                count(&self.reads.dropped);
                log::info!("fault: report {} of {} is dropped", meta.sequence, self.since_opened(meta.at));
                self.refuse_an_endless_read(wait, begin)?;
                continue;
            }
            if let Some(bit) = faults.corrupt {
                count(&self.reads.corrupted);
                let (bit_of_byte, byte) = (bit % 8, bit / 8);
                log::info!("fault: bit {bit_of_byte} of byte {byte} of report {} is flipped", meta.sequence);
                frame = flip_bit(&frame, bit);
            }
            self.queue(&frame, meta, faults)?;
        }
    }

    /// Queues a report after the delayed reports; twice if it is duplicated.
    fn queue(&self, frame: &Frame, meta: ReadMeta, faults: random::FrameFaults) -> Result<(), LinkError> {
        let now = self.clock.now()?;
        let mut pending = self.pending.lock();
        let due = if faults.delay { now + self.options.delay } else { now };
        let copies = if faults.duplicate && pending.len() + 2 <= PENDING_MAX { 2 } else { 1 };
        for _ in 0..copies {
            pending.push_back(PendingReport { frame: frame.clone(), meta, due });
        }
        drop(pending);
        if faults.delay {
            count(&self.reads.delayed);
            log::info!("fault: report {} is held up for {:?}", meta.sequence, self.options.delay);
        }
        if copies == 2 {
            count(&self.reads.duplicated);
            log::info!("fault: report {} arrives twice", meta.sequence);
        }
        Ok(())
    }

    /// Waits until the oldest delayed report is due, then removes and returns it; `None` at once if there is none.
    /// Fails if the timeout `wait` of the read `call` passes first, or if the read is cancelled.
    fn take_pending(&self, call: &Call, wait: Wait, out: &mut Frame) -> Result<Option<ReadMeta>, LinkError> {
        loop {
            let due = {
                let mut pending = self.pending.lock();
                let Some(due) = pending.front().map(|first| first.due) else { return Ok(None) };
                if due <= self.clock.now()?
                    && let Some(first) = pending.pop_front()
                {
                    out.clone_from(&first.frame);
                    return Ok(Some(first.meta));
                }
                due
            };
            let limit = self.options.disconnect_at.map_or(due, |limit| due.min(limit));
            let is_due = self.clock.wait_until(call, limit)?;
            self.check_connected()?;
            if !is_due {
                return Err(timeout(Dir::Read, wait, "the report is held up (fault.delay)"));
            }
        }
    }

    /// Returns an error for a read that would never end: on a virtual clock, without a time limit, when all reports are
    /// dropped.
    fn refuse_an_endless_read(&self, wait: Wait, begin: Duration) -> Result<(), LinkError> {
        let endless = wait == Wait::Forever && self.clock.is_virtual() && self.options.disconnect_at.is_none();
        if endless && self.options.read.drop == Fraction::ONE {
            let waited = Wait::For(self.clock.now()?.saturating_sub(begin));
            return Err(timeout(Dir::Read, waited, "every report is dropped (fault.drop is 1)"));
        }
        Ok(())
    }
}

fn flip_bit(frame: &Frame, bit: usize) -> Frame {
    let mut corrupted = frame.clone();
    corrupted.bytes_mut()[bit / 8] ^= 1 << (bit % 8);
    corrupted
}

fn timeout(dir: Dir, wait: Wait, what: &'static str) -> LinkError {
    LinkError::Timeout { dir, waited: wait.limit().unwrap_or_default(), what }
}

impl Layer for FaultLink {
    fn inner(&self) -> &dyn Link {
        &*self.inner
    }

    fn info(&self) -> LinkInfo {
        self.info.clone()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.finish(&self.writes, self.write_frame(frame, wait))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.finish(&self.reads, self.read_report(out, wait))
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        self.check_connected()?;
        self.inner.pass(time)
    }

    fn cancel(&self, dir: Dir) {
        self.clock.cancel(dir);
        self.inner.cancel(dir);
    }

    fn close(&self) {
        self.closed.store(true, Ordering::Release);
        self.clock.close();
        self.inner.close();
    }

    fn vanish(&self) {
        self.closed.store(true, Ordering::Release);
        self.clock.close();
        self.inner.vanish();
    }

    fn check(&self) -> Result<(), LinkError> {
        self.check_connected()?;
        self.inner.check()
    }

    fn stats(&self) -> LinkStats {
        LinkStats {
            written: read(&self.writes.done),
            read: read(&self.reads.done),
            write_errors: read(&self.writes.failed),
            read_errors: read(&self.reads.failed),
            faults: FaultStats {
                write: self.writes.faults(),
                read: self.reads.faults(),
                disconnected: self.disconnected.get().is_some(),
            },
            ..self.inner.stats()
        }
    }
}
