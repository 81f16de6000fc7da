//! Faults on demand: a [`Link`] around any link that loses, turns over, doubles and holds up frames, and takes the board
//! away, so that a program's handling of errors can be tested without breaking a cable.
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
//! What happens to which frame is fixed by the seed, for each direction by itself: with one calling thread on a virtual
//! clock a program sees the same every time. Every fault is counted in [`LinkStats::faults`] and logged. A recording is
//! around the faults: it holds what the program has seen and not what the board has.
//!
//! \[OURS] How each fault looks to a program:
//! - *drop*: a write succeeds and the board gets nothing; a report never comes, and leaves a gap in the sequence.
//! - *corrupt*: one bit of a frame is turned over, anywhere in its slots.
//! - *duplicate*: the board takes a frame twice; a report is read twice, with the same sequence number.
//! - *delay*: a write takes that much longer, or reaches its limit and the frame was not taken; a report is held up with
//!   those behind it, and comes with a later read if the limit of this one is reached. None overtakes another.
//! - *disconnect*: [`LinkError::Lost`] from every call, and every wait ends with it, until the link is opened again. With
//!   `fault.disconnect_after` that many calls succeed. `fault.disconnect_ms` is time of the machine, on a virtual clock
//!   time of the board.

mod clock;
mod dice;
mod options;
mod stats;

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use parking_lot::Mutex;

pub use options::{FaultOptions, FaultRates};
pub use stats::{FaultCounts, FaultStats};

use super::{Dir, Fraction, Layer, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::{Frame, SlotSize};
use clock::{Call, Clock, LOOK};
use dice::Dice;
use stats::{Counters, count, read};

/// Reports that may be held up at once. One reading thread has two at most, one and its double.
const HELD_MAX: usize = 64;

/// A report that is on its way.
struct Held {
    frame: Frame,
    meta: ReadMeta,
    /// When it comes, since the link was opened.
    due: Duration,
}

/// A link with faults.
pub struct FaultLink {
    inner: Arc<dyn Link>,
    info: LinkInfo,
    options: FaultOptions,
    clock: Clock,
    dice: [Mutex<Dice>; 2],
    held: Mutex<VecDeque<Held>>,
    writes: Counters,
    reads: Counters,
    /// Why the board is gone: the key that took it away.
    gone: OnceLock<&'static str>,
    /// The program has closed it.
    closed: AtomicBool,
}

impl FaultLink {
    /// Puts faults between a program and `inner`.
    pub fn new(inner: Arc<dyn Link>, options: FaultOptions) -> Self {
        let info = inner.info();
        let bits = info.slot.unwrap_or(SlotSize::Bytes12).frame_len() * 8;
        let dice = |dir, rates| Mutex::new(Dice::new(options.seed, dir, rates, bits));
        Self {
            clock: Clock::new(Arc::clone(&inner), &info),
            inner,
            info,
            options,
            dice: [dice(Dir::Write, options.write), dice(Dir::Read, options.read)],
            held: Mutex::new(VecDeque::with_capacity(HELD_MAX)),
            writes: Counters::default(),
            reads: Counters::default(),
            gone: OnceLock::new(),
            closed: AtomicBool::new(false),
        }
    }

    /// Ends a call: counts it, and takes the board away if its frame was the last one.
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
                Err(self.lost().unwrap_or(error))
            }
        }
    }

    /// Takes the board away. The link to it is closed, which ends every wait.
    fn disconnect(&self, key: &'static str) {
        if self.gone.set(key).is_ok() {
            log::warn!("fault: `{}` is disconnected ({key})", self.info.name);
            self.clock.end();
            self.inner.close();
        }
    }

    /// The error of a board that is gone; `None` while it is there, and once the program has closed it.
    fn lost(&self) -> Option<LinkError> {
        let reason = *self.gone.get()?;
        let closed = self.closed.load(Ordering::Acquire);
        (!closed).then(|| LinkError::Lost { name: self.info.name.clone(), reason: reason.into() })
    }

    /// Whether the board is there.
    fn alive(&self) -> Result<(), LinkError> {
        if let Some(lost) = self.lost() {
            return Err(lost);
        }
        if let Some(limit) = self.options.disconnect_at
            && self.clock.now()? >= limit
        {
            self.disconnect("fault.disconnect_ms");
        }
        self.lost().map_or(Ok(()), Err)
    }

    fn write_frame(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.alive()?;
        let call = self.clock.call(Dir::Write, wait)?;
        let lot = self.dice[0].lock().roll();
        let until = self.options.disconnect_at;
        if lot.delay {
            count(&self.writes.delayed);
            log::info!("fault: a command frame is held up for {:?}", self.options.delay);
            let due = self.clock.now()? + self.options.delay;
            let come = self.clock.wait_until(&call, until.map_or(due, |until| due.min(until)))?;
            self.alive()?;
            if !come {
                return Err(timeout(Dir::Write, wait, "the frame is held up (fault.delay)"));
            }
        }
        if lot.drop {
            count(&self.writes.dropped);
            // It takes its time on the wire all the same.
            self.inner.pass(LOOK)?;
            let at = self.clock.stamp(self.clock.now()?);
            log::info!("fault: a command frame is dropped at {} us", at.0 / 1000);
            return Ok(at);
        }
        let turned = lot.corrupt.map(|bit| {
            count(&self.writes.corrupted);
            log::info!("fault: bit {} of byte {} of a command frame is turned over", bit % 8, bit / 8);
            turn_over(frame, bit)
        });
        let frame = turned.as_ref().unwrap_or(frame);
        let left = if lot.delay || until.is_some() { self.clock.left(&call, until)? } else { wait };
        let at = match self.inner.write(frame, left) {
            Err(LinkError::Timeout { .. }) => {
                self.alive()?;
                return Err(timeout(Dir::Write, wait, "the board takes no more frames"));
            }
            done => done?,
        };
        if lot.duplicate && self.inner.write(frame, self.clock.left(&call, until)?).is_ok() {
            count(&self.writes.duplicated);
            log::info!("fault: the command frame of {} us arrives twice", at.0 / 1000);
        }
        Ok(at)
    }

    fn read_report(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.alive()?;
        let call = self.clock.call(Dir::Read, wait)?;
        let begin = self.clock.now()?;
        let mut frame = Frame::new();
        loop {
            self.clock.check(&call)?;
            if let Some(meta) = self.take_held(&call, wait, out)? {
                return Ok(meta);
            }
            let left = self.clock.left(&call, self.options.disconnect_at)?;
            let meta = match self.inner.read(&mut frame, left) {
                Err(LinkError::Timeout { .. }) => {
                    self.alive()?;
                    return Err(timeout(Dir::Read, wait, "no report came"));
                }
                done => done?,
            };
            self.alive()?;
            let lot = self.dice[1].lock().roll();
            if lot.drop {
                count(&self.reads.dropped);
                log::info!("fault: report {} of {} us is dropped", meta.sequence, meta.at.0 / 1000);
                self.refuse_an_endless_read(wait, begin)?;
                continue;
            }
            if let Some(bit) = lot.corrupt {
                count(&self.reads.corrupted);
                let (bit_of_byte, byte) = (bit % 8, bit / 8);
                log::info!("fault: bit {bit_of_byte} of byte {byte} of report {} is turned over", meta.sequence);
                frame = turn_over(&frame, bit);
            }
            self.hold(&frame, meta, lot)?;
        }
    }

    /// Puts a report behind those that are on their way.
    fn hold(&self, frame: &Frame, meta: ReadMeta, lot: dice::Lot) -> Result<(), LinkError> {
        let now = self.clock.now()?;
        let mut held = self.held.lock();
        let due = if lot.delay { now + self.options.delay } else { now };
        let copies = if lot.duplicate && held.len() + 2 <= HELD_MAX { 2 } else { 1 };
        for _ in 0..copies {
            held.push_back(Held { frame: frame.clone(), meta, due });
        }
        drop(held);
        if lot.delay {
            count(&self.reads.delayed);
            log::info!("fault: report {} is held up for {:?}", meta.sequence, self.options.delay);
        }
        if copies == 2 {
            count(&self.reads.duplicated);
            log::info!("fault: report {} arrives twice", meta.sequence);
        }
        Ok(())
    }

    /// The oldest report that is on its way, once it comes; `None`: there is none.
    fn take_held(&self, call: &Call, wait: Wait, out: &mut Frame) -> Result<Option<ReadMeta>, LinkError> {
        loop {
            let due = {
                let mut held = self.held.lock();
                let Some(due) = held.front().map(|first| first.due) else { return Ok(None) };
                if due <= self.clock.now()?
                    && let Some(first) = held.pop_front()
                {
                    out.clone_from(&first.frame);
                    return Ok(Some(first.meta));
                }
                due
            };
            let limit = self.options.disconnect_at.map_or(due, |limit| due.min(limit));
            let come = self.clock.wait_until(call, limit)?;
            self.alive()?;
            if !come {
                return Err(timeout(Dir::Read, wait, "the report is held up (fault.delay)"));
            }
        }
    }

    /// On a virtual clock a read without a limit would go on for ever in a single call if every report is lost.
    fn refuse_an_endless_read(&self, wait: Wait, begin: Duration) -> Result<(), LinkError> {
        let endless = wait == Wait::Forever && self.clock.is_virtual() && self.options.disconnect_at.is_none();
        if endless && self.options.read.drop == Fraction::ONE {
            let waited = Wait::For(self.clock.now()?.saturating_sub(begin));
            return Err(timeout(Dir::Read, waited, "every report is dropped (fault.drop is 1)"));
        }
        Ok(())
    }
}

fn turn_over(frame: &Frame, bit: usize) -> Frame {
    let mut turned = frame.clone();
    turned.bytes_mut()[bit / 8] ^= 1 << (bit % 8);
    turned
}

fn timeout(dir: Dir, wait: Wait, what: &'static str) -> LinkError {
    let waited = match wait {
        Wait::For(limit) => limit,
        Wait::Forever | Wait::Now => Duration::ZERO,
    };
    LinkError::Timeout { dir, waited, what }
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
        self.alive()?;
        self.inner.pass(time)
    }

    fn cancel(&self, dir: Dir) {
        self.clock.cancel(dir);
        self.inner.cancel(dir);
    }

    fn close(&self) {
        self.closed.store(true, Ordering::Release);
        self.clock.end();
        self.inner.close();
    }

    fn vanish(&self) {
        self.closed.store(true, Ordering::Release);
        self.clock.end();
        self.inner.vanish();
    }

    fn check(&self) -> Result<(), LinkError> {
        self.alive()?;
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
                disconnected: self.gone.get().is_some(),
            },
            ..self.inner.stats()
        }
    }
}
