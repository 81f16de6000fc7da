//! Time and waits for fault injection. Times count from the opening of the link, on the clock of the inner link.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::link::{Dir, Link, LinkError, LinkInfo, Stamp, Wait};
use crate::threads::WaitQueue;
use crate::threads::sync::unlockable::{Mutex, MutexGuard};

/// How far a call that does not wait advances a virtual clock, so that a program that polls makes progress \[OURS]: one
/// USB microframe, as for a write to a simulated board.
pub(super) const POLL_TIME: Duration = Duration::from_micros(125);

/// The events that end a wait early: cancelling and closing.
#[derive(Clone, Copy, Default)]
struct Cancellation {
    /// The number of cancellations so far, by direction.
    cancels: [u64; 2],
    /// Whether the link is closed.
    closed: bool,
}

/// The time since the link was opened, and waits that [`Clock::cancel`] and [`Clock::close`] end.
pub(super) struct Clock {
    inner: Arc<dyn Link>,
    virtual_time: bool,
    opened_at: Stamp,
    opened: Instant,
    cancellation: Mutex<Cancellation>,
    changed: WaitQueue,
}

/// A call to the link that may wait.
#[derive(Clone, Copy)]
pub(super) struct Call {
    pub(super) dir: Dir,
    /// The number of cancellations in its direction when the call began. A higher number later shows that the call was
    /// cancelled.
    cancels: u64,
    /// When the timeout of the call passes; `None`: never.
    deadline: Option<Duration>,
    /// Whether the call must not wait at all.
    no_wait: bool,
}

impl Clock {
    pub(super) fn new(inner: Arc<dyn Link>, info: &LinkInfo) -> Self {
        Self {
            inner,
            virtual_time: info.virtual_time,
            opened_at: info.opened_at,
            opened: Instant::now(),
            cancellation: Mutex::default(),
            changed: WaitQueue::new(),
        }
    }

    pub(super) const fn is_virtual(&self) -> bool {
        self.virtual_time
    }

    /// The time since the link was opened. Fails if the inner link has failed.
    pub(super) fn now(&self) -> Result<Duration, LinkError> {
        match self.inner.pass(Duration::ZERO)? {
            Some(Stamp(now)) => Ok(Duration::from_nanos(now.saturating_sub(self.opened_at.0))),
            None => Ok(self.opened.elapsed()),
        }
    }

    /// Converts a time since the link was opened to a time stamp of the link's frames.
    pub(super) fn stamp(&self, now: Duration) -> Stamp {
        Stamp(self.opened_at.0.saturating_add(u64::try_from(now.as_nanos()).unwrap_or(u64::MAX)))
    }

    /// Begins a read or a write that may wait for as long as `wait` allows. Fails if the inner link has failed.
    pub(super) fn call(&self, dir: Dir, wait: Wait) -> Result<Call, LinkError> {
        let cancels = self.cancellation.lock().cancels[dir as usize];
        let deadline = match wait.limit() {
            None => None,
            Some(limit) => self.now()?.checked_add(limit),
        };
        Ok(Call { dir, cancels, deadline, no_wait: wait.limit() == Some(Duration::ZERO) })
    }

    /// Returns an error if the call was cancelled or the link was closed.
    pub(super) fn check(&self, call: &Call) -> Result<(), LinkError> {
        let cancellation = *self.cancellation.lock();
        if cancellation.closed {
            return Err(LinkError::Closed);
        }
        let cancelled = cancellation.cancels[call.dir as usize] != call.cancels;
        if cancelled { Err(LinkError::Cancelled { dir: call.dir }) } else { Ok(()) }
    }

    /// How much longer the call may wait: until its deadline, or until the time `latest` if that is earlier. Fails if
    /// the inner link has failed.
    pub(super) fn remaining(&self, call: &Call, latest: Option<Duration>) -> Result<Wait, LinkError> {
        let end = call.deadline.into_iter().chain(latest).min();
        let Some(end) = end else { return Ok(Wait::Forever) };
        let left = end.saturating_sub(self.now()?);
        Ok(if call.no_wait { Wait::Now } else { Wait::at_most(left) })
    }

    /// Waits until `time`, or until the call's deadline if that is earlier. Returns whether `time` has come. Fails if
    /// the call is cancelled, the link is closed, or the inner link has failed.
    pub(super) fn wait_until(&self, call: &Call, time: Duration) -> Result<bool, LinkError> {
        let to = call.deadline.map_or(time, |end| end.min(time));
        if self.virtual_time {
            let left = to.saturating_sub(self.now()?);
            self.inner.pass(if call.no_wait { POLL_TIME } else { left })?;
        } else {
            let mut cancellation = self.cancellation.lock();
            while self.opened.elapsed() < to
                && !cancellation.closed
                && cancellation.cancels[call.dir as usize] == call.cancels
            {
                let left = to.saturating_sub(self.opened.elapsed());
                let ticket = self.changed.ticket();
                MutexGuard::unlocked(&mut cancellation, || self.changed.wait(ticket, Some(left)));
            }
            drop(cancellation);
            self.check(call)?;
        }
        Ok(self.now()? >= time)
    }

    /// Ends the present waits of reads or of writes.
    pub(super) fn cancel(&self, dir: Dir) {
        self.cancellation.lock().cancels[dir as usize] += 1;
        self.changed.notify_all();
    }

    /// Ends every wait, now and in future.
    pub(super) fn close(&self) {
        self.cancellation.lock().closed = true;
        self.changed.notify_all();
    }
}
