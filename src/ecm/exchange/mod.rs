//! The exchange of frames and reports with the board. All calls of [`Ecm`](super::Ecm) use it, also in several threads,
//! and every wait has a timeout.
//!
//! Without a stream, each waiting thread writes frames and reads reports itself. While a stream is open, the steps of
//! the stream do that: the commands of other threads go out in the stream's frames. A frame of their own would be a
//! FIFO entry without new targets, and so a gap in the motion.
//!
//! How to read this folder: `mod.rs` writes frames and reads reports. `task.rs` sends the commands of a call and waits
//! for their effect. `session.rs` has the state between calls, with a file for each part of it:
//!
//! - `reports.rs`: the newest reports, and the rules by which a report is discarded;
//! - `outgoing.rs`, `posts.rs`, `cyclic_targets.rs`: the next frame and the last one, the commands that wait for the next
//!   frame, and the targets that a stream repeats in every frame;
//! - `credit.rs`, `marks.rs`, `answers.rs`: how much room the FIFO has, which frames the board has executed, which answers
//!   belong to which command;
//! - `patience.rs`: the clock of timeouts, which leaves out stalls of this process;
//! - `second_channels.rs`: the state of second channels of HSPs, which only SDO transfers show;
//! - `stats.rs`: counters, and news for a log; `slot_set.rs`: sets of slots.

mod answers;
mod credit;
pub mod cyclic_targets;
pub mod marks;
mod outgoing;
mod patience;
mod posts;
mod reports;
mod second_channels;
pub mod session;
mod slot_set;
mod stats;
mod task;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use parking_lot::{Condvar, Mutex, MutexGuard};

pub use outgoing::Sent;
use patience::Patience;
pub use patience::Waited;
pub use second_channels::SecondChannels;
pub use session::Session;
pub use stats::{News, Stats};
pub use task::{EFFECT_REPORTS_MAX, Task, ahead_of_the_board};

use super::EcmError;
use super::config::Config;
use super::network::Network;
use super::options::Options;
use crate::link::{Link, LinkError, LinkInfo, Stamp, Wait};
use crate::sk::{RawSlot, SlotSize};

/// \[OURS] If an open stream makes no step for this long, the calls of other threads write frames of their own instead of
/// waiting for the stream's next frame.
const STREAM_PAUSE_MAX: Duration = Duration::from_millis(50);
/// \[OURS] A report that is older than this many cycles does not show the present positions of the axes.
const REPORT_AGE_CYCLES: u32 = 3;
/// \[OURS] The longest timeout of a call: a year.
pub const LIMIT_MAX: Duration = Duration::from_secs(365 * 86_400);
/// \[OURS] The most reports that one call reads without waiting. By default the queue of a link holds fewer, so a call
/// normally reads all waiting reports. The limit ends a call if reports come faster than it reads them.
const CATCH_UP_REPORTS_MAX: usize = 4096;

/// A function of the program that is called during a wait of a call. It returns `true` if the wait is to end.
type Interrupt = Box<dyn Fn() -> bool + Send + Sync>;

pub struct Exchange {
    pub link: Arc<dyn Link>,
    pub info: LinkInfo,
    pub options: Options,
    patience: Patience,
    session: Mutex<Session>,
    /// Generation counter: incremented whenever state that a `Stream` reads has changed, such as a new report, another
    /// configuration, an axis that is homing, or a cleared FIFO.
    changes: AtomicU64,
    /// Wakes the threads that wait: signalled when a report was read, when claimed slots were released, and when the
    /// board was closed.
    news: Condvar,
    /// Whether a stream ended while another thread had the lock of the session. The session then counts the stream as
    /// open until the next call takes the lock.
    abandoned: AtomicBool,
    /// Held by the call that uses the SDO slot, so that there is one transfer at a time.
    pub sdo_turn: Mutex<()>,
    /// Held by the call that is homing axes, so that there is one such call at a time.
    pub homing_turn: Mutex<()>,
    /// A function of the program that is called during waits. If it returns `true`, the wait ends with an error, see
    /// [`Ecm::with_interrupt`](super::Ecm::with_interrupt).
    pub interrupt: Option<Interrupt>,
}

impl Exchange {
    pub fn new(link: Arc<dyn Link>, info: LinkInfo, size: SlotSize, options: Options) -> Self {
        let options = Options {
            read_limit: options.read_limit.min(LIMIT_MAX),
            write_limit: options.write_limit.min(LIMIT_MAX),
            state_limit: options.state_limit.min(LIMIT_MAX),
            sdo_limit: options.sdo_limit.min(LIMIT_MAX),
            servo_limit: options.servo_limit.min(LIMIT_MAX),
            ..options
        };
        Self {
            link,
            info,
            options,
            patience: Patience::new(),
            session: Mutex::new(Session::new(size, options.strict_crc)),
            changes: AtomicU64::new(0),
            news: Condvar::new(),
            abandoned: AtomicBool::new(false),
            sdo_turn: Mutex::new(()),
            homing_turn: Mutex::new(()),
            interrupt: None,
        }
    }

    /// The time on the clock of timeouts, from an arbitrary start. It is the link's clock minus the stalls of this
    /// process (SIGSTOP, swap, a suspended machine): a stalled process cannot read reports, so they must not count as
    /// missing.
    pub fn now(&self) -> Duration {
        self.now_at(self.clock())
    }

    /// As [`Exchange::now`], for a caller that has read the link's clock already.
    pub fn now_at(&self, clock: Duration) -> Duration {
        self.patience.at(clock)
    }

    /// The time on the link's clock, from an arbitrary start.
    pub fn clock(&self) -> Duration {
        if self.info.virtual_time
            && let Ok(Some(at)) = self.link.pass(Duration::ZERO)
        {
            return Duration::from_nanos(at.0);
        }
        self.patience.elapsed()
    }

    /// Whether the newest report is older than [`REPORT_AGE_CYCLES`], so that it does not show the present positions of
    /// the axes. Its age includes stalls of this process.
    pub fn is_stale(&self, session: &Session) -> bool {
        let age = self.clock().saturating_sub(session.reports.read_at);
        age > session.network.cycle() * REPORT_AGE_CYCLES
    }

    pub fn lock(&self) -> Result<MutexGuard<'_, Session>, EcmError> {
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

    /// As [`Exchange::lock`], and then reads all reports that are waiting, up to the newest one.
    pub fn lock_newest(&self) -> Result<MutexGuard<'_, Session>, EcmError> {
        let mut session = self.lock()?;
        self.catch_up(&mut session)?;
        Ok(session)
    }

    /// As [`Exchange::lock_newest`], with an error outside OP; `what`: the call that needs OP.
    pub fn lock_in_op(&self, what: &'static str) -> Result<MutexGuard<'_, Session>, EcmError> {
        let session = self.lock_newest()?;
        session.require_op(what)?;
        Ok(session)
    }

    /// Called when a stream ends while another thread has the lock of the session: the next call that gets the lock removes the
    /// stream.
    pub fn abandon(&self) {
        self.abandoned.store(true, Ordering::Release);
    }

    /// The time without a report after which the board counts as silent: the read timeout, but at least three cycles.
    pub fn silence_max(&self, session: &Session) -> Duration {
        self.options.read_limit.max(session.network.cycle() * 3)
    }

    /// Generation counter: incremented whenever state that a `Stream` reads has changed. A `Stream` takes the lock of the
    /// session only if this number differs from the one of its copy.
    pub fn changes(&self) -> u64 {
        self.changes.load(Ordering::Acquire)
    }

    /// Increments the generation counter. To be called after state that a `Stream` reads was changed.
    pub fn changed(&self) {
        self.changes.fetch_add(1, Ordering::Release);
    }

    /// Sets the configuration of the slaves, against which calls are checked from now on.
    pub fn set_network(&self, config: &Config) -> Result<(), EcmError> {
        let network = Arc::new(Network::of(config));
        let mut session = self.lock()?;
        session.network = network;
        session.second_channels = SecondChannels::new();
        drop(session);
        self.changed();
        Ok(())
    }

    /// Reads a report, and waits for it until `deadline` at most. Returns whether it got a usable one.
    pub fn read(&self, session: &mut Session, deadline: Duration) -> Result<bool, EcmError> {
        self.read_at(session, self.now(), deadline)
    }

    /// As [`Exchange::read`], for a caller that knows the present time.
    pub fn read_at(&self, session: &mut Session, now: Duration, deadline: Duration) -> Result<bool, EcmError> {
        let wait = deadline.saturating_sub(now).min(self.silence_max(session)).min(patience::WAIT_MAX);
        self.patience.expect(wait);
        match self.link.read(&mut session.reports.incoming, Wait::at_most(wait)) {
            Ok(meta) => {
                let usable = session.take_report(meta);
                if usable {
                    session.reports.heard_at = now;
                    session.reports.read_at =
                        if self.info.virtual_time { Duration::from_nanos(meta.at.0) } else { self.patience.elapsed() };
                    self.changed();
                    self.news.notify_all();
                }
                Ok(usable)
            }
            Err(LinkError::Timeout { .. } | LinkError::Silent { .. }) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Reads all reports that are waiting, so that decisions use the newest one. In virtual time a read lets time pass,
    /// so a report is read only if a cycle has passed since the newest one.
    pub fn catch_up(&self, session: &mut Session) -> Result<(), EcmError> {
        for _ in 0..CATCH_UP_REPORTS_MAX {
            if self.info.virtual_time {
                let (Some(meta), Some(cycle)) = (session.reports.meta, session.network.cycle_ns) else { return Ok(()) };
                // `pass` of a zero duration returns the present board time and lets no time pass; a lost link returns
                // its error.
                let now = self.link.pass(Duration::ZERO)?;
                if now.is_some_and(|now| now.0 < meta.at.0 + cycle) {
                    return Ok(());
                }
            }
            let reads = session.stats.reads();
            self.read(session, Duration::ZERO)?;
            if session.stats.reads() == reads {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Writes the next frame by `deadline`. The caller has checked that the board has room for it.
    pub fn write(&self, session: &mut Session, deadline: Duration) -> Result<(), EcmError> {
        self.write_within(session, deadline.saturating_sub(self.now()).min(self.options.write_limit))
    }

    /// Writes a frame with these commands by `deadline`. A slot of a frame has room for one command: if a queued command
    /// of another thread uses one of the slots, a frame with that command is written first.
    pub fn write_commands(
        &self,
        session: &mut Session,
        commands: &[(usize, RawSlot)],
        deadline: Duration,
    ) -> Result<(), EcmError> {
        if !session.posts.post(commands) {
            self.write(session, deadline)?;
            session.posts.post(commands);
        }
        self.write(session, deadline)
    }

    /// Writes the next frame within `limit`.
    pub fn write_within(&self, session: &mut Session, limit: Duration) -> Result<(), EcmError> {
        session.compose();
        let clears = session.fifo_clears;
        self.patience.expect(limit);
        match self.link.write(&session.outgoing.frame, Wait::For(limit)) {
            Ok(at) => {
                session.wrote(at);
                if session.fifo_clears != clears {
                    self.changed();
                }
                Ok(())
            }
            // A CSP target leads further beyond a soft limit of the machine file. The board has got the frame without
            // CSP targets.
            Err(LinkError::BeyondLimit { at_ns, why }) => {
                let hsps = session.network.hsps;
                session.targets.stepped_without_csp(hsps);
                session.wrote(Stamp(at_ns));
                if session.fifo_clears != clears {
                    self.changed();
                }
                Err(LinkError::BeyondLimit { at_ns, why }.into())
            }
            // The frame was not written, so its targets are taken back. Its commands stay queued for the next frame,
            // unless the call that queued them withdraws them.
            Err(error) => {
                session.targets.revert();
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

    /// Returns an error if no report has come for too long, counted from the last report or from `since`, whichever is
    /// later.
    pub fn check_silence(&self, session: &Session, since: Duration, what: &'static str) -> Result<(), EcmError> {
        let waited = self.now().saturating_sub(session.reports.heard_at.max(since));
        if waited < self.silence_max(session) {
            return Ok(());
        }
        Err(self.no_report(what, waited, session.stats.bad_crc))
    }

    /// The error of a board that has made no usable report for `waited`.
    pub fn no_report(&self, what: &'static str, waited: Duration, bad_crc: u64) -> EcmError {
        EcmError::NoReport { what, waited, bad_crc, network_down: self.link.stats().network_down }
    }

    /// One round of a wait: writes a frame if commands were posted, and reads a report. While another thread has a
    /// stream open, it waits for a step of the stream instead.
    pub fn round(&self, session: &mut MutexGuard<'_, Session>, deadline: Duration) -> Result<(), EcmError> {
        if let Some(pacer) = session.pacer
            && pacer.thread != thread::current().id()
            && pacer.last_step.elapsed() < STREAM_PAUSE_MAX
        {
            self.news.wait_for(session, STREAM_PAUSE_MAX);
            return if session.closed { Err(LinkError::Closed.into()) } else { Ok(()) };
        }
        if !session.posts.is_empty() {
            // The newest free count decides whether the board has room.
            self.catch_up(session)?;
            if session.may_write() {
                self.write(session, deadline)?;
            }
        }
        self.read(session, deadline)?;
        Ok(())
    }

    /// Releases the lock of the session to other threads between two rounds, and runs `between` without the lock. Ends
    /// the wait if it is to be interrupted.
    pub fn pause(&self, session: &mut MutexGuard<'_, Session>, between: impl FnOnce()) -> Result<(), EcmError> {
        let is_interrupted = MutexGuard::unlocked_fair(session, || {
            between();
            self.interrupt.as_ref().is_some_and(|is_due| is_due())
        });
        if session.closed {
            return Err(LinkError::Closed.into());
        }
        if is_interrupted { Err(EcmError::Interrupted) } else { Ok(()) }
    }

    /// Ends every use of the board. If axes may be moving, the link is closed by [`Link::vanish`]: a server behind the
    /// link then stops the axes, as it does for a program that was killed.
    pub fn shut(&self, is_at_rest: bool) {
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
