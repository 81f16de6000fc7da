//! Tasks: the commands of a call, and the wait until reports show their effect.

use std::time::Duration;

use parking_lot::MutexGuard;

use super::outgoing::Sent;
use super::patience::Waited;
use super::session::Session;
use super::{Exchange, LIMIT_MAX};
use crate::ecm::EcmError;
use crate::sk::{FIFO_ENTRIES, RawSlot};

/// \[OURS] After this many reports a command that shows no effect is sent again, and a GO_HOME without an answer counts
/// as lost. The number covers the cycles that a full FIFO takes, and some more for the drive.
pub const EFFECT_REPORTS_MAX: u64 = FIFO_ENTRIES as u64 + 40;

/// Commands of a call and the wait for their effect, with a timeout.
pub struct Task<'a> {
    /// The name of the operation, for errors.
    pub what: &'static str,
    /// Advice for the user if the operation is not done in time.
    pub hint: &'static str,
    pub limit: Duration,
    /// The commands, each with its slot. A task without commands only waits.
    pub commands: &'a [(usize, RawSlot)],
    /// Describes what the board shows instead of the effect, for the text of a timeout.
    seen: &'a dyn Fn(&Session) -> String,
    /// Whether the commands may be sent again if they show no effect.
    resend: bool,
    /// Whether the call must recognise the answers to its own commands, and so claims their slots.
    claim_exclusive: bool,
}

impl<'a> Task<'a> {
    /// A task whose commands may be sent again, and whose effect counts even if another call has caused it.
    pub fn new(what: &'static str, hint: &'static str, limit: Duration, commands: &'a [(usize, RawSlot)]) -> Self {
        let seen = &|session: &Session| format!("the board is in {}", session.board().state);
        Self { what, hint, limit, commands, seen, resend: true, claim_exclusive: false }
    }

    /// Replaces the board's state in the text of a timeout by what `seen` describes.
    pub fn seen(self, seen: &'a dyn Fn(&Session) -> String) -> Self {
        Self { seen, ..self }
    }

    /// Sends the commands only once, also if they show no effect.
    pub fn once(self) -> Self {
        Self { resend: false, ..self }
    }

    /// Lets the call recognise the answers to its own commands: it claims their slots, and first overwrites an older
    /// answer that may look the same.
    pub fn exclusive(self) -> Self {
        Self { claim_exclusive: true, ..self }
    }
}

/// How far the commands of a task have been sent.
#[derive(Default)]
struct Delivery {
    /// Whether the task has claimed its slots, so that no other call uses them.
    claimed: bool,
    /// The number of frames that had been written when the commands were queued; `None` while they are not queued.
    posted_at: Option<u64>,
    /// Whether the slots get an empty command first, and the task's commands in a later frame. Outside OP a slot shows
    /// the id of its last command. If that is the id of the task's command, the new answer could not be told from the old
    /// one.
    clears: bool,
}

impl Delivery {
    /// Queues the commands for the next frame, unless they are queued already.
    fn post(&mut self, session: &mut Session, task: &Task<'_>) {
        if self.posted_at.is_some() {
            return;
        }
        if task.claim_exclusive && !self.claimed {
            self.claimed = session.claim(task.commands);
            if !self.claimed {
                return;
            }
        }
        let is_shown = |(slot, command): &(usize, RawSlot)| session.slot(*slot).id == command.id;
        self.clears = task.claim_exclusive && !session.in_op() && task.commands.iter().any(is_shown);
        let posted = if self.clears {
            task.commands.iter().all(|(slot, _)| session.posts.post(&[(*slot, RawSlot::ZERO)]))
        } else {
            session.posts.post(task.commands)
        };
        if posted {
            self.posted_at = Some(session.outgoing.written);
        }
    }

    /// The frame that carries the commands; `None` until it was written.
    fn sent(&mut self, session: &Session) -> Option<Sent> {
        if self.posted_at.is_none_or(|frames| session.outgoing.written == frames) {
            return None;
        }
        self.posted_at = None;
        (!self.clears).then_some(session.outgoing.last)
    }
}

/// Describes how many entries the board has still to execute, for the text of a timeout.
pub fn ahead_of_the_board(session: &Session) -> String {
    format!("{} entries are ahead of the board", session.credit.ahead())
}

impl Exchange {
    /// Sends the commands of a task and passes each later report to `look`. The wait ends when `look` returns a value or
    /// an error.
    ///
    /// # Errors
    /// Those of `look`; [`EcmError::Timeout`] after the limit of the task, [`EcmError::NoReport`], [`EcmError::Link`].
    pub fn run<T>(
        &self,
        task: &Task<'_>,
        look: impl FnMut(&mut Session, Sent) -> Result<Option<T>, EcmError>,
    ) -> Result<T, EcmError> {
        self.run_with(task, |_| Ok(()), look, || {})
    }

    /// As [`Exchange::run`]. `before` is called until the commands were sent, and may return an error. `between` runs
    /// without the lock of the session between two rounds, while other threads may take it.
    pub fn run_with<T>(
        &self,
        task: &Task<'_>,
        before: impl FnMut(&mut Session) -> Result<(), EcmError>,
        look: impl FnMut(&mut Session, Sent) -> Result<Option<T>, EcmError>,
        between: impl FnMut(),
    ) -> Result<T, EcmError> {
        let mut session = self.lock_newest()?;
        session.marks.awaited += 1;
        let mut delivery = Delivery::default();
        let done = self.run_rounds(&mut session, &mut delivery, task, (before, look, between));
        session.marks.awaited -= 1;
        // Withdraws commands that are still queued. Once a frame has carried them, their slots may hold queued commands
        // of another call, which must stay.
        if delivery.posted_at == Some(session.outgoing.written) {
            session.posts.withdraw(task.commands);
        }
        if delivery.claimed {
            session.answers.release(task.commands);
            self.news.notify_all();
        }
        done
    }

    fn run_rounds<T>(
        &self,
        session: &mut MutexGuard<'_, Session>,
        delivery: &mut Delivery,
        task: &Task<'_>,
        (mut before, mut look, mut between): (
            impl FnMut(&mut Session) -> Result<(), EcmError>,
            impl FnMut(&mut Session, Sent) -> Result<Option<T>, EcmError>,
            impl FnMut(),
        ),
    ) -> Result<T, EcmError> {
        let began = self.now();
        let mut waited = Waited::since(began);
        let limit = task.limit.min(LIMIT_MAX);
        let mut sent = None;
        let mut reports = session.stats.reports;
        if task.commands.is_empty() {
            sent = Some(Sent { at: session.reports.at(), number: 0, mark: 0 });
        }
        let mut sent_reports = reports;
        loop {
            if sent.is_none() {
                before(session)?;
                delivery.post(session, task);
            }
            let now = self.now();
            self.round(session, now + limit.saturating_sub(waited.until(now, session.network.cycle())))?;
            if let Some(now) = delivery.sent(session) {
                sent = Some(now);
                sent_reports = session.stats.reports;
            }
            if let Some(sent) = sent
                && session.stats.reports > reports
                && session.reports.meta.is_some_and(|meta| meta.at > sent.at)
                && let Some(done) = look(session, sent)?
            {
                return Ok(done);
            }
            reports = session.stats.reports;
            let waited = waited.until(self.now(), session.network.cycle());
            self.check_silence(session, began, task.what)?;
            if waited >= limit {
                let seen = (task.seen)(session);
                return Err(EcmError::Timeout { what: task.what, waited, seen, hint: task.hint });
            }
            if let Some(now) = sent
                && !task.commands.is_empty()
                && reports - sent_reports >= EFFECT_REPORTS_MAX
            {
                sent_reports = reports;
                if session.in_op() && !session.executed(now) && session.credit.has_executed(now.number) {
                    session.marks.note_missing();
                }
                if task.resend {
                    sent = None;
                }
            }
            self.pause(session, &mut between)?;
        }
    }
}
