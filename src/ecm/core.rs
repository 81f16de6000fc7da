//! The exchange with the board that all of [`Ecm`](super::Ecm) goes through: it may be used from several threads, and
//! every wait has a limit.
//!
//! Without a stream, whoever waits for something writes and reads. While a stream runs, its steps do: commands of other
//! threads ride in its frames, so that none of them takes an entry from the motion.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::EcmError;
use super::config::Config;
use super::options::Options;
use super::session::Session;
use super::snapshot::Plan;
use crate::link::{Link, LinkError, LinkInfo, Stamp, Wait};
use crate::sk::{RawSlot, SlotSize};

/// \[OURS] A stream that has not stepped for that long no longer carries commands of other threads.
const STREAM_SLEEPS: Duration = Duration::from_millis(50);
/// \[OURS] A command without an effect is sent again after this many reports: more than the FIFO and a handshake take.
const RESEND_REPORTS: u32 = 200;
/// \[OURS] Reports read in a row without waiting: more than any queue of a link holds by default.
const DRAIN_MAX: usize = 4096;

pub(super) struct Core {
    pub(super) link: Arc<dyn Link>,
    pub(super) info: LinkInfo,
    pub(super) options: Options,
    started: Instant,
    session: Mutex<Session>,
    /// Counts what a stream has to look at again: reports, another plan, an axis that homes.
    changes: AtomicU64,
    news: Condvar,
    pub(super) sdo_turn: Mutex<()>,
    pub(super) homing_turn: Mutex<()>,
}

/// One thing to do: what goes out, for how long, and whether it may go out again.
pub(super) struct Task<'a> {
    pub(super) what: &'static str,
    pub(super) hint: &'static str,
    pub(super) limit: Duration,
    pub(super) commands: &'a [(usize, RawSlot)],
    pub(super) resend: bool,
}

/// When and as which entry a command went out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sent {
    pub(super) at: Stamp,
    pub(super) number: i64,
}

impl Core {
    pub(super) fn new(link: Arc<dyn Link>, info: LinkInfo, size: SlotSize, options: Options) -> Self {
        Self {
            link,
            info,
            options,
            started: Instant::now(),
            session: Mutex::new(Session::new(size, options.strict_crc)),
            changes: AtomicU64::new(0),
            news: Condvar::new(),
            sdo_turn: Mutex::new(()),
            homing_turn: Mutex::new(()),
        }
    }

    /// Time on the link's clock, from any zero.
    pub(super) fn now(&self) -> Duration {
        if self.info.virtual_time
            && let Ok(Some(at)) = self.link.pass(Duration::ZERO)
        {
            return Duration::from_nanos(at.0);
        }
        self.started.elapsed()
    }

    pub(super) fn lock(&self) -> Result<MutexGuard<'_, Session>, EcmError> {
        let limit = self.options.read_limit + self.options.write_limit;
        let session = self.session.try_lock_for(limit).ok_or(EcmError::Busy { what: "the board" })?;
        if session.closed { Err(LinkError::Closed.into()) } else { Ok(session) }
    }

    /// How long the board may be silent.
    pub(super) fn patience(&self, session: &Session) -> Duration {
        self.options.read_limit.max(session.plan.cycle() * 3)
    }

    /// How often anything has changed that a stream looks at.
    pub(super) fn changes(&self) -> u64 {
        self.changes.load(Ordering::Acquire)
    }

    /// Something of the session has changed; the caller has it locked.
    pub(super) fn changed(&self) {
        self.changes.fetch_add(1, Ordering::Release);
    }

    /// Says what the slaves are.
    pub(super) fn plan(&self, config: &Config) -> Result<(), EcmError> {
        let plan = Arc::new(Plan::of(config));
        self.lock()?.plan = plan;
        self.changed();
        Ok(())
    }

    /// Reads a report that comes by `deadline`; says whether there was one that can be used.
    pub(super) fn read(&self, session: &mut Session, deadline: Duration) -> Result<bool, EcmError> {
        self.read_at(session, self.now(), deadline)
    }

    /// As [`Core::read`], for a caller that knows the time.
    pub(super) fn read_at(&self, session: &mut Session, now: Duration, deadline: Duration) -> Result<bool, EcmError> {
        let wait = match deadline.saturating_sub(now).min(self.patience(session)) {
            Duration::ZERO => Wait::Now,
            left => Wait::For(left),
        };
        match self.link.read(&mut session.incoming, wait) {
            Ok(meta) => {
                let usable = session.take(meta);
                if usable {
                    session.heard = now;
                    self.changed();
                    self.news.notify_all();
                }
                Ok(usable)
            }
            Err(LinkError::Timeout { .. } | LinkError::Silent { .. }) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Reads what is there already, so that decisions rest on the newest report. On virtual time looking costs time, so
    /// it is only done where a report is due.
    pub(super) fn catch_up(&self, session: &mut Session) -> Result<(), EcmError> {
        for _ in 0..DRAIN_MAX {
            if self.info.virtual_time {
                let (Some(meta), Some(cycle)) = (session.meta, session.plan.cycle_ns) else { return Ok(()) };
                // A board that is gone says so here.
                let now = self.link.pass(Duration::ZERO)?;
                if now.is_some_and(|now| now.0 < meta.at.0 + cycle) {
                    return Ok(());
                }
            }
            let reads = session.stats.reports + session.stats.bad_crc + session.stats.stale;
            self.read(session, Duration::ZERO)?;
            if session.stats.reports + session.stats.bad_crc + session.stats.stale == reads {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Writes the next frame by `deadline`. The caller has seen that the board takes one.
    pub(super) fn write(&self, session: &mut Session, deadline: Duration) -> Result<(), EcmError> {
        self.write_within(session, deadline.saturating_sub(self.now()).min(self.options.write_limit))
    }

    /// Writes the next frame, within that time.
    pub(super) fn write_within(&self, session: &mut Session, limit: Duration) -> Result<(), EcmError> {
        session.compose();
        let clears = session.clears;
        match self.link.write(&session.outgoing, Wait::For(limit)) {
            Ok(at) => {
                session.wrote(at);
                if session.clears != clears {
                    self.changed();
                }
                Ok(())
            }
            Err(error) => {
                session.failed();
                Err(match error {
                    LinkError::Timeout { waited, what, .. } => EcmError::Timeout {
                        what: "writing a frame",
                        waited,
                        seen: what.to_owned(),
                        hint: "see whether the board still reports (Ecm::next_cycle), else switch it off and on",
                    },
                    other => other.into(),
                })
            }
        }
    }

    /// The error of a board that has been silent since `since`, if that is too long.
    pub(super) fn check_silence(&self, session: &Session, since: Duration, what: &'static str) -> Result<(), EcmError> {
        let waited = self.now().saturating_sub(session.heard.max(since));
        if waited < self.patience(session) {
            return Ok(());
        }
        Err(EcmError::NoReport { what, waited, bad_crc: session.stats.bad_crc })
    }

    /// One round: a report, and the frame with what was posted. By the stream, if one runs in another thread.
    pub(super) fn round(&self, session: &mut MutexGuard<'_, Session>, deadline: Duration) -> Result<(), EcmError> {
        if let Some(pacer) = session.pacer
            && pacer.thread != thread::current().id()
            && pacer.last_step.elapsed() < STREAM_SLEEPS
        {
            self.news.wait_for(session, STREAM_SLEEPS);
            return if session.closed { Err(LinkError::Closed.into()) } else { Ok(()) };
        }
        if session.has_posts() {
            // The newest free count decides.
            self.catch_up(session)?;
            if session.may_write() {
                self.write(session, deadline)?;
            }
        }
        self.read(session, deadline)?;
        Ok(())
    }

    /// Lets others have the session between two rounds.
    pub(super) fn pause<'a>(&'a self, session: MutexGuard<'a, Session>) -> Result<MutexGuard<'a, Session>, EcmError> {
        MutexGuard::unlock_fair(session);
        self.lock()
    }

    /// Sends a task's commands and looks at each report made after that, until `look` has what it wants.
    ///
    /// `look` gives `Ok(None)` while it waits. A task without commands waits only.
    pub(super) fn run<T>(
        &self,
        task: &Task<'_>,
        mut look: impl FnMut(&mut Session, Sent) -> Result<Option<T>, EcmError>,
        seen: impl Fn(&Session) -> String,
    ) -> Result<T, EcmError> {
        let began = self.now();
        let deadline = began + task.limit;
        let mut session = self.lock()?;
        self.catch_up(&mut session)?;
        let mut sent = None;
        let mut posted = None;
        let mut reports = session.stats.reports;
        if task.commands.is_empty() {
            sent = Some(Sent { at: session.meta.map_or(Stamp(0), |meta| meta.at), number: 0 });
        }
        let mut sent_reports = reports;
        loop {
            if sent.is_none() && posted.is_none() && session.post(task.commands) {
                posted = Some(session.flushes);
            }
            if let Err(error) = self.round(&mut session, deadline) {
                if posted.is_some() {
                    session.withdraw(task.commands);
                }
                return Err(error);
            }
            if posted.is_some_and(|flushes| session.flushes > flushes) {
                posted = None;
                sent = Some(Sent { at: session.flushed_at, number: session.flushed_number });
                sent_reports = session.stats.reports;
            }
            if let Some(sent) = sent
                && session.stats.reports > reports
                && session.meta.is_some_and(|meta| meta.at > sent.at)
                && let Some(done) = look(&mut session, sent)?
            {
                return Ok(done);
            }
            reports = session.stats.reports;
            let waited = self.now().saturating_sub(began);
            if waited >= task.limit {
                if posted.is_some() {
                    session.withdraw(task.commands);
                }
                self.check_silence(&session, began, task.what)?;
                let seen = seen(&session);
                return Err(EcmError::Timeout { what: task.what, waited, seen, hint: task.hint });
            }
            if let Err(error) = self.check_silence(&session, began, task.what) {
                if posted.is_some() {
                    session.withdraw(task.commands);
                }
                return Err(error);
            }
            if task.resend && sent.is_some() && reports - sent_reports >= u64::from(RESEND_REPORTS) {
                sent = None;
            }
            session = self.pause(session)?;
        }
    }

    /// Ends every use.
    pub(super) fn shut(&self) {
        if let Some(mut session) = self.session.try_lock_for(self.options.read_limit) {
            session.closed = true;
        }
        self.link.close();
        self.news.notify_all();
    }
}
