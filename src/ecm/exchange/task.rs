//! Tasks: commands that go out, and the wait until reports show what they have done.

use std::time::Duration;

use parking_lot::MutexGuard;

use super::outgoing::Sent;
use super::session::Session;
use super::{Exchange, LIMIT_MAX};
use crate::ecm::EcmError;
use crate::sk::RawSlot;

/// \[OURS] A command without an effect is sent again after this many reports: more than the FIFO and a handshake take.
const RESEND_REPORTS: u64 = 200;

/// Something that a call has the board do, within a limit.
pub struct Task<'a> {
    /// What it is, for errors.
    pub what: &'static str,
    /// What a user can do if it is not done in time.
    pub hint: &'static str,
    pub limit: Duration,
    /// What is sent, by slot. A task without commands only waits.
    pub commands: &'a [(usize, RawSlot)],
    /// Whether the commands may go out again, if they show no effect.
    pub resend: bool,
    /// Whether the call must be sure of the answers to its own commands. Then no other such call has the slots meanwhile,
    /// and an answer that stands in them already is cleared first.
    pub claim_exclusive: bool,
}

/// How far the commands of a task are on their way.
#[derive(Default)]
struct Delivery {
    /// The slots are claimed.
    claimed: bool,
    /// The number of frames that were written when the commands were put into the next one.
    posted_at: Option<u64>,
    /// What was posted are slots that ask for nothing: outside OP a slot shows the last id, which must not be that of the
    /// task's command before it has gone out.
    clears: bool,
}

impl Delivery {
    /// Puts the commands into the next frame, unless they are there already.
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

    /// The frame with which the commands went out, once it was written.
    fn sent(&mut self, session: &Session) -> Option<Sent> {
        if self.posted_at.is_none_or(|frames| session.outgoing.written == frames) {
            return None;
        }
        self.posted_at = None;
        (!self.clears).then_some(session.outgoing.last)
    }
}

impl Exchange {
    /// Sends a task's commands and gives each report that is made after that to `look`, until that has what it wants: it gives
    /// `Ok(None)` while it waits. `seen` says for the error of a timeout what the board showed instead.
    pub fn run<T>(
        &self,
        task: &Task<'_>,
        look: impl FnMut(&mut Session, Sent) -> Result<Option<T>, EcmError>,
        seen: impl Fn(&Session) -> String,
    ) -> Result<T, EcmError> {
        self.run_with(task, |_| Ok(()), look, || {}, seen)
    }

    /// As [`Exchange::run`]; `before` may refuse as long as the commands have not gone out, and `between` runs between two
    /// rounds, while the session is free for other threads.
    pub fn run_with<T>(
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
        let mut delivery = Delivery::default();
        let done = self.run_rounds(&mut session, &mut delivery, task, (before, look, between, seen));
        session.marks.awaited -= 1;
        // What has gone out cannot be taken back, and its slot may hold another call's command by now.
        if delivery.posted_at == Some(session.outgoing.written) {
            session.posts.withdraw(task.commands);
        }
        if delivery.claimed {
            session.release(task.commands);
            self.news.notify_all();
        }
        done
    }

    fn run_rounds<T>(
        &self,
        session: &mut MutexGuard<'_, Session>,
        delivery: &mut Delivery,
        task: &Task<'_>,
        (mut before, mut look, mut between, seen): (
            impl FnMut(&mut Session) -> Result<(), EcmError>,
            impl FnMut(&mut Session, Sent) -> Result<Option<T>, EcmError>,
            impl FnMut(),
            impl Fn(&Session) -> String,
        ),
    ) -> Result<T, EcmError> {
        let began = self.now();
        let limit = task.limit.min(LIMIT_MAX);
        let deadline = began + limit;
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
            self.round(session, deadline)?;
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
            let waited = self.now().saturating_sub(began);
            if waited >= limit {
                self.check_silence(session, began, task.what)?;
                return Err(EcmError::Timeout { what: task.what, waited, seen: seen(session), hint: task.hint });
            }
            self.check_silence(session, began, task.what)?;
            if let Some(now) = sent
                && !task.commands.is_empty()
                && reports - sent_reports >= RESEND_REPORTS
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
