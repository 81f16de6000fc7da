//! The exchange with the board that all of [`Ecm`](super::Ecm) goes through: it may be used from several threads, and
//! every wait has a limit.
//!
//! Without a stream, whoever waits for something writes and reads. While a stream runs, its steps do: commands of other
//! threads ride in its frames, so that none of them takes an entry from the motion.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::EcmError;
use super::config::Config;
use super::options::Options;
use super::second::Second;
use super::session::Session;
use super::snapshot::Plan;
use crate::link::{Link, LinkError, LinkInfo, Stamp, Wait};
use crate::sk::{RawSlot, SlotSize};

/// \[OURS] A stream that has not stepped for that long no longer carries commands of other threads.
const STREAM_SLEEPS: Duration = Duration::from_millis(50);
/// \[OURS] A command without an effect is sent again after this many reports: more than the FIFO and a handshake take.
const RESEND_REPORTS: u32 = 200;
/// \[OURS] No limit is longer: a year.
pub(super) const LONGEST: Duration = Duration::from_secs(365 * 86_400);
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
    /// A stream has ended that the session still knows.
    abandoned: AtomicBool,
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
    /// It must be sure of its own answer: nobody else that must has the slots meanwhile, and an answer that stands there
    /// already is cleared away first.
    pub(super) own: bool,
}

/// How far the commands of a task are on their way.
#[derive(Default)]
struct Post {
    claimed: bool,
    /// Frames that were written when they were put into the next one.
    at: Option<u64>,
    /// They ask for nothing yet: outside OP slots show the last id, which must not be theirs.
    clears: bool,
}

impl Post {
    /// Puts them into the next frame, unless they are there already.
    fn put(&mut self, session: &mut Session, task: &Task<'_>) {
        if self.at.is_some() {
            return;
        }
        if task.own && !self.claimed {
            self.claimed = session.claim(task.commands);
            if !self.claimed {
                return;
            }
        }
        let stands = |(slot, command): &(usize, RawSlot)| session.slot(*slot).id == command.id;
        self.clears = task.own && !session.in_op() && task.commands.iter().any(stands);
        let put = if self.clears {
            task.commands.iter().all(|(slot, _)| session.post(&[(*slot, RawSlot::ZERO)]))
        } else {
            session.post(task.commands)
        };
        if put {
            self.at = Some(session.flushes);
        }
    }

    /// As what they went out, if they did.
    fn went(&mut self, session: &Session) -> Option<Sent> {
        if self.at.is_none_or(|flushes| session.flushes == flushes) {
            return None;
        }
        self.at = None;
        let sent = Sent { at: session.flushed_at, number: session.flushed_number, mark: session.flushed_mark };
        (!self.clears).then_some(sent)
    }
}

/// When and as which entry a command went out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sent {
    pub(super) at: Stamp,
    pub(super) number: i64,
    pub(super) mark: u8,
}

impl Core {
    pub(super) fn new(link: Arc<dyn Link>, info: LinkInfo, size: SlotSize, options: Options) -> Self {
        let options = Options {
            read_limit: options.read_limit.min(LONGEST),
            write_limit: options.write_limit.min(LONGEST),
            state_limit: options.state_limit.min(LONGEST),
            sdo_limit: options.sdo_limit.min(LONGEST),
            servo_limit: options.servo_limit.min(LONGEST),
            ..options
        };
        Self {
            link,
            info,
            options,
            started: Instant::now(),
            session: Mutex::new(Session::new(size, options.strict_crc)),
            changes: AtomicU64::new(0),
            news: Condvar::new(),
            abandoned: AtomicBool::new(false),
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
        let mut session = self.session.try_lock_for(limit).ok_or(EcmError::Busy { what: "the board" })?;
        if session.closed {
            return Err(LinkError::Closed.into());
        }
        if self.abandoned.swap(false, Ordering::AcqRel) {
            session.end_stream();
        }
        Ok(session)
    }

    /// A stream ended that could not have the session: whoever has it next ends it there.
    pub(super) fn abandon(&self) {
        self.abandoned.store(true, Ordering::Release);
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
        let mut session = self.lock()?;
        session.plan = plan;
        session.second = Second::new();
        drop(session);
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
            // What it held waits for the next one; who sent it may take it back.
            Err(error) => {
                session.targets.unstep();
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

    /// Sends a task's commands and looks at each report made after that, until `look` has what it wants.
    ///
    /// `look` gives `Ok(None)` while it waits. A task without commands waits only.
    pub(super) fn run<T>(
        &self,
        task: &Task<'_>,
        look: impl FnMut(&mut Session, Sent) -> Result<Option<T>, EcmError>,
        seen: impl Fn(&Session) -> String,
    ) -> Result<T, EcmError> {
        self.run_with(task, |_| Ok(()), look, || {}, seen)
    }

    /// As [`Core::run`]; `before` may refuse as long as the commands have not gone out, and `between` runs between two
    /// rounds, without the session.
    pub(super) fn run_with<T>(
        &self,
        task: &Task<'_>,
        before: impl FnMut(&mut Session) -> Result<(), EcmError>,
        look: impl FnMut(&mut Session, Sent) -> Result<Option<T>, EcmError>,
        between: impl FnMut(),
        seen: impl Fn(&Session) -> String,
    ) -> Result<T, EcmError> {
        let mut session = self.lock()?;
        self.catch_up(&mut session)?;
        session.marks.awaited += 1;
        let mut post = Post::default();
        let done = self.rounds(&mut session, &mut post, task, (before, look, between, seen));
        session.marks.awaited -= 1;
        // What has gone out cannot be taken back, and the slot may be another's by now.
        if post.at == Some(session.flushes) {
            session.withdraw(task.commands);
        }
        if post.claimed {
            session.release(task.commands);
            self.news.notify_all();
        }
        done
    }

    fn rounds<T>(
        &self,
        session: &mut MutexGuard<'_, Session>,
        post: &mut Post,
        task: &Task<'_>,
        (mut before, mut look, mut between, seen): (
            impl FnMut(&mut Session) -> Result<(), EcmError>,
            impl FnMut(&mut Session, Sent) -> Result<Option<T>, EcmError>,
            impl FnMut(),
            impl Fn(&Session) -> String,
        ),
    ) -> Result<T, EcmError> {
        let began = self.now();
        let limit = task.limit.min(LONGEST);
        let deadline = began + limit;
        let mut sent = None;
        let mut reports = session.stats.reports;
        if task.commands.is_empty() {
            sent = Some(Sent { at: session.meta.map_or(Stamp(0), |meta| meta.at), number: 0, mark: 0 });
        }
        let mut sent_reports = reports;
        loop {
            if sent.is_none() {
                before(session)?;
                post.put(session, task);
            }
            self.round(session, deadline)?;
            if let Some(now) = post.went(session) {
                sent = Some(now);
                sent_reports = session.stats.reports;
            }
            if let Some(sent) = sent
                && session.stats.reports > reports
                && session.meta.is_some_and(|meta| meta.at > sent.at)
                && let Some(done) = look(session, sent)?
            {
                return Ok(done);
            }
            reports = session.stats.reports;
            let waited = self.now().saturating_sub(began);
            if waited >= limit {
                self.check_silence(session, began, task.what)?;
                return Err(EcmError::Timeout { what: task.what, waited, seen: seen(session), hint: task.hint });
            }
            self.check_silence(session, began, task.what)?;
            if let Some(now) = sent
                && !task.commands.is_empty()
                && reports - sent_reports >= u64::from(RESEND_REPORTS)
            {
                sent_reports = reports;
                if session.in_op() && !session.executed(now) && session.credit.ran(now.number) {
                    session.marks.miss();
                }
                if task.resend {
                    sent = None;
                }
            }
            self.pause(session, &mut between)?;
        }
    }

    /// Lets others have the session between two rounds.
    pub(super) fn pause(&self, session: &mut MutexGuard<'_, Session>, between: impl FnOnce()) -> Result<(), EcmError> {
        MutexGuard::unlocked_fair(session, between);
        if session.closed { Err(LinkError::Closed.into()) } else { Ok(()) }
    }

    /// Ends every use. A program whose axes are not as it wanted them has vanished for whoever serves the board.
    pub(super) fn shut(&self, is_at_rest: bool) {
        if let Some(mut session) = self.session.try_lock_for(self.options.read_limit) {
            session.closed = true;
        }
        if is_at_rest {
            self.link.close();
        } else {
            self.link.vanish();
        }
        self.news.notify_all();
    }
}
