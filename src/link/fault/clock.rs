//! The wrapper's time and waits: since the link was opened, on the clock that the link lives in.

use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};

use crate::link::{Dir, Link, LinkError, LinkInfo, Stamp, Wait};

/// What a look at a virtual clock costs, so that a program that polls does not stop it \[OURS]: one USB microframe, as the
/// board has it.
pub(super) const LOOK: Duration = Duration::from_micros(125);

/// Cancels so far, by direction.
#[derive(Clone, Copy, Default)]
struct Ends {
    cancels: [u64; 2],
    over: bool,
}

/// Time since the link was opened, and waits that [`Clock::cancel`] and [`Clock::end`] end.
pub(super) struct Clock {
    inner: Arc<dyn Link>,
    virtual_time: bool,
    opened_at: Stamp,
    opened: Instant,
    ends: Mutex<Ends>,
    bell: Condvar,
}

/// A call under way.
#[derive(Clone, Copy)]
pub(super) struct Call {
    pub(super) dir: Dir,
    cancels: u64,
    /// When its wait ends; `None`: it does not.
    end: Option<Duration>,
    /// It was not to wait.
    at_once: bool,
}

impl Clock {
    pub(super) fn new(inner: Arc<dyn Link>, info: &LinkInfo) -> Self {
        Self {
            inner,
            virtual_time: info.virtual_time,
            opened_at: info.opened_at,
            opened: Instant::now(),
            ends: Mutex::default(),
            bell: Condvar::new(),
        }
    }

    pub(super) const fn is_virtual(&self) -> bool {
        self.virtual_time
    }

    /// Time since the link was opened.
    pub(super) fn now(&self) -> Result<Duration, LinkError> {
        match self.inner.pass(Duration::ZERO)? {
            Some(Stamp(now)) => Ok(Duration::from_nanos(now.saturating_sub(self.opened_at.0))),
            None => Ok(self.opened.elapsed()),
        }
    }

    /// That time since the link was opened, as the link's frames show it.
    pub(super) fn stamp(&self, now: Duration) -> Stamp {
        Stamp(self.opened_at.0.saturating_add(u64::try_from(now.as_nanos()).unwrap_or(u64::MAX)))
    }

    /// A call begins that may wait that long.
    pub(super) fn call(&self, dir: Dir, wait: Wait) -> Result<Call, LinkError> {
        let cancels = self.ends.lock().cancels[place(dir)];
        let end = match wait {
            Wait::Forever => None,
            Wait::For(limit) => self.now()?.checked_add(limit),
            Wait::Now => Some(self.now()?),
        };
        Ok(Call { dir, cancels, end, at_once: wait == Wait::Now || wait == Wait::For(Duration::ZERO) })
    }

    /// Whether the call may go on.
    pub(super) fn check(&self, call: &Call) -> Result<(), LinkError> {
        let ends = *self.ends.lock();
        if ends.over {
            return Err(LinkError::Closed);
        }
        let cancelled = ends.cancels[place(call.dir)] != call.cancels;
        if cancelled { Err(LinkError::Cancelled { dir: call.dir }) } else { Ok(()) }
    }

    /// How long the call may still wait, and not beyond `latest`.
    pub(super) fn left(&self, call: &Call, latest: Option<Duration>) -> Result<Wait, LinkError> {
        let end = call.end.into_iter().chain(latest).min();
        let Some(end) = end else { return Ok(Wait::Forever) };
        let left = end.saturating_sub(self.now()?);
        Ok(if call.at_once || left.is_zero() { Wait::Now } else { Wait::For(left) })
    }

    /// Waits until that time, but not beyond the call's end. Says whether the time has come.
    pub(super) fn wait_until(&self, call: &Call, time: Duration) -> Result<bool, LinkError> {
        let to = call.end.map_or(time, |end| end.min(time));
        if self.virtual_time {
            let left = to.saturating_sub(self.now()?);
            self.inner.pass(if call.at_once { LOOK } else { left })?;
        } else {
            let mut ends = self.ends.lock();
            while self.opened.elapsed() < to && !ends.over && ends.cancels[place(call.dir)] == call.cancels {
                let left = to.saturating_sub(self.opened.elapsed());
                self.bell.wait_for(&mut ends, left);
            }
            drop(ends);
            self.check(call)?;
        }
        Ok(self.now()? >= time)
    }

    /// Ends the waits under way in one direction.
    pub(super) fn cancel(&self, dir: Dir) {
        self.ends.lock().cancels[place(dir)] += 1;
        self.bell.notify_all();
    }

    /// Ends every wait now and to come.
    pub(super) fn end(&self) {
        self.ends.lock().over = true;
        self.bell.notify_all();
    }
}

const fn place(dir: Dir) -> usize {
    match dir {
        Dir::Write => 0,
        Dir::Read => 1,
    }
}
