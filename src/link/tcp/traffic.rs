//! The client's end while it is open: whose call receives, who may send, what a wait ends with.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::DEAD_AFTER;
use super::channel::{Came, Channel, Out};
use super::exchange::{Answer, Exchange};
use super::failure::timeout;
use super::hang::{Idle, InForce};
use super::inbox::Inbox;
use super::wire::{Message, Role};
use crate::link::{Dir, KnownNetwork, LinkError, LinkInfo, ReadMeta, Stamp, Wait};
use crate::sk::Frame;
use crate::span::Span;

/// While nobody waits in a call, somebody looks at least this often what came. \[OURS]
const LOOK: Duration = Duration::from_millis(20);

pub(super) struct Shared {
    pub(super) info: LinkInfo,
    pub(super) board: String,
    /// What the server knows of the network.
    pub(super) network: KnownNetwork,
    pub(super) role: Role,
    pub(super) keepalive: Duration,
    /// Where a program that hangs shall be noticed: what it has left in force.
    pub(super) in_force: Option<InForce>,
    pub(super) channel: Channel,
    pub(super) out: Mutex<Sender>,
    pub(super) inbox: Mutex<Inbox>,
    pub(super) state: Mutex<State>,
    pub(super) changed: Condvar,
    pub(super) over: Condvar,
    pub(super) counts: Calls,
}

pub(super) struct Sender {
    pub(super) out: Out,
    pub(super) last: Instant,
}

pub(super) struct State {
    pub(super) exchange: Exchange,
    /// Somebody is receiving.
    pub(super) receiving: bool,
    /// Others wait for what it receives.
    pub(super) followers: u32,
    pub(super) cancels: [u64; 2],
}

#[derive(Default)]
pub(super) struct Calls {
    pub(super) written: AtomicU64,
    pub(super) read: AtomicU64,
    pub(super) write_errors: AtomicU64,
    pub(super) read_errors: AtomicU64,
}

impl Shared {
    /// How long the other end may say nothing.
    pub(super) fn patience(&self) -> Duration {
        self.keepalive * DEAD_AFTER
    }

    /// The thread in the background: receives while nobody waits, says that the client is there, notices that the server
    /// is not.
    pub(super) fn keep(&self) {
        let look = LOOK.min(self.keepalive / 4);
        let mut idle = Idle::new(Instant::now());
        let mut state = self.state.lock();
        while state.exchange.ended.is_none() {
            self.over.wait_for(&mut state, look);
            if !state.receiving {
                state = self.lead(state, Some(Instant::now()));
            }
            let silent = state.exchange.heard.elapsed();
            if silent > self.patience() {
                state.exchange.lose(format!("no word of its server for {}", Span(silent)));
            }
            if let Some(in_force) = &self.in_force
                && let Some(silent) = idle.look(self.calls(&state), is_called(&state), Instant::now(), in_force)
            {
                let reason = format!(
                    "the program made no call for {} while axes move by its velocity or torque (hang_ms=); open it again",
                    Span(silent)
                );
                state.exchange.lose(reason.clone());
                // Axes first: the server sees this end at once.
                self.channel.end(true);
                log::warn!("`{}`: {reason}", self.info.name);
            }
            if state.exchange.ended.is_none() {
                MutexGuard::unlocked(&mut state, || self.ping());
            }
        }
        drop(state);
        self.changed.notify_all();
        self.channel.wake();
    }

    /// Calls that were made so far.
    fn calls(&self, state: &State) -> u64 {
        let Calls { written, read, write_errors, read_errors } = &self.counts;
        let ended: u64 =
            [written, read, write_errors, read_errors].map(|count| count.load(Ordering::Relaxed)).iter().sum();
        ended + state.exchange.requests()
    }

    fn ping(&self) {
        let Some(mut sender) = self.out.try_lock() else { return };
        let Sender { out, last } = &mut *sender;
        if last.elapsed() >= self.keepalive / 2 && out.is_empty() {
            *last = Instant::now();
            // What goes wrong shows when receiving.
            let _ = self.channel.stage(&Message::Ping, out).and_then(|()| self.channel.push(out));
        }
    }

    /// Sends a message whole, or ends the exchange.
    fn send(&self, message: &Message<'_>) -> std::io::Result<()> {
        let mut sender = self.out.lock();
        let Sender { out, last } = &mut *sender;
        *last = Instant::now();
        self.channel.stage(message, out)?;
        self.channel.flush(out, *last + self.patience())
    }

    /// Receives, for everybody who waits, until something came, a wake-up or `until`.
    fn lead<'a>(&'a self, mut state: MutexGuard<'a, State>, until: Option<Instant>) -> MutexGuard<'a, State> {
        state.receiving = true;
        let came = MutexGuard::unlocked(&mut state, || self.receive(until));
        state.receiving = false;
        if let Err(error) = came {
            state.exchange.lose(format!("{error}"));
        }
        if state.followers > 0 {
            self.changed.notify_all();
        }
        state
    }

    fn receive(&self, until: Option<Instant>) -> std::io::Result<()> {
        let mut inbox = self.inbox.lock();
        let left = until.map(|until| until.saturating_duration_since(Instant::now()));
        let may_wait = left != Some(Duration::ZERO);
        // Whoever may wait has to, as a rule: then looking first is in vain.
        let mut came = Came::Nothing;
        if !may_wait || self.channel.keeps_some() {
            came = self.channel.receive(&mut inbox)?;
        }
        if came == Came::Nothing && may_wait {
            self.channel.wait(false, left)?;
            came = self.channel.receive(&mut inbox)?;
        }
        let mut state = self.state.lock();
        match came {
            Came::Nothing => {}
            Came::Bytes | Came::All => {
                state.exchange.heard = Instant::now();
                state.exchange.take_all(&mut inbox);
            }
            Came::End => state.exchange.lose("its server has closed the connection"),
        }
        Ok(())
    }

    /// Waits until `look` has something, at most until `until`. At least one look is at what has come by now.
    fn wait<'a, T>(
        &'a self,
        mut state: MutexGuard<'a, State>,
        until: Option<Instant>,
        mut look: impl FnMut(&mut State) -> Option<T>,
    ) -> (MutexGuard<'a, State>, Option<T>) {
        let mut received = false;
        loop {
            if let Some(done) = look(&mut state) {
                return (state, Some(done));
            }
            let late = until.is_some_and(|until| Instant::now() >= until);
            if late && received {
                return (state, None);
            }
            received = true;
            if !state.receiving {
                state = self.lead(state, until);
                continue;
            }
            if late {
                return (state, None);
            }
            state.followers += 1;
            match until {
                None => self.changed.wait(&mut state),
                Some(until) => drop(self.changed.wait_until(&mut state, until)),
            }
            state.followers -= 1;
        }
    }

    /// Sends a request and waits for its answer. The server keeps the limit; whatever it does, the wait ends.
    pub(super) fn request<'a>(
        &'a self,
        dir: Dir,
        wait: Wait,
        message: impl FnOnce(u64) -> Message<'a>,
    ) -> (MutexGuard<'a, State>, Result<Answer, LinkError>) {
        let limit = end_after(wait);
        let state = self.state.lock();
        let cancels = state.cancels[dir as usize];
        // One at a time.
        let (mut state, turn) = self.wait(state, limit, |state| {
            if let Some(ended) = &state.exchange.ended {
                return Some(Err(ended.error.clone()));
            }
            if state.cancels[dir as usize] != cancels {
                return Some(Err(LinkError::Cancelled { dir }));
            }
            state.exchange.request.is_none().then(|| Ok(state.exchange.begin(dir, wait)))
        });
        let number = match turn {
            None => return (state, Err(timeout(dir, wait))),
            Some(Err(error)) => return (state, Err(error)),
            Some(Ok(number)) => number,
        };
        let sent = MutexGuard::unlocked(&mut state, || self.send(&message(number)));
        if let Err(error) = sent {
            // The server cannot have it: it did not get it whole.
            let error = LinkError::Lost { name: self.info.name.clone(), reason: error.to_string().into() };
            state.exchange.end(error.clone(), false);
            return self.done(state, Err(error));
        }
        let hard = limit.map(|limit| limit + self.patience());
        let (mut state, mut done) = self.wait(state, hard, |state| self.answer(state, dir, cancels, false));
        if let Some(Err(None)) = done {
            MutexGuard::unlocked(&mut state, || self.send(&Message::Cancel { request: number })).ok();
            let hard = Some(Instant::now() + self.patience());
            (state, done) = self.wait(state, hard, |state| self.answer(state, dir, cancels, true));
        }
        match done {
            Some(Ok(answer)) => self.done(state, Ok(answer)),
            Some(Err(Some(error))) => self.done(state, Err(error)),
            Some(Err(None)) | None => {
                state.exchange.lose("its server does not answer");
                self.over.notify_all();
                let error = self.ended(&state, dir);
                self.done(state, Err(error))
            }
        }
    }

    /// The answer to the request under way, or the error it ends with; `Err(None)`: it was cancelled.
    fn answer(
        &self,
        state: &mut State,
        dir: Dir,
        cancels: u64,
        is_told: bool,
    ) -> Option<Result<Answer, Option<LinkError>>> {
        if let Some(answer) = state.exchange.request.as_mut().and_then(|request| request.answer.take()) {
            return Some(Ok(answer));
        }
        if state.exchange.ended.is_some() {
            return Some(Err(Some(self.ended(state, dir))));
        }
        (!is_told && dir == Dir::Write && state.cancels[dir as usize] != cancels).then_some(Err(None))
    }

    /// The error of a request that the end of the exchange has cut off.
    fn ended(&self, state: &State, dir: Dir) -> LinkError {
        match &state.exchange.ended {
            Some(ended) if ended.unsure && dir == Dir::Write => {
                let reason = match &ended.error {
                    LinkError::Lost { reason, .. } => reason.to_string(),
                    other => other.to_string(),
                };
                LinkError::Unsure { name: self.info.name.clone(), reason }
            }
            Some(ended) => ended.error.clone(),
            None => LinkError::Closed,
        }
    }

    fn done<'a, T>(&self, mut state: MutexGuard<'a, State>, done: T) -> (MutexGuard<'a, State>, T) {
        state.exchange.request = None;
        if state.followers > 0 {
            self.changed.notify_all();
        }
        (state, done)
    }

    pub(super) fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        if self.role == Role::Reader {
            return Err(LinkError::Io {
                what: format!("write to `{}`", self.info.name),
                message: "it is a reader's link; open it with role=writer".to_owned(),
            });
        }
        let bytes = frame.bytes();
        match self.request(Dir::Write, wait, |request| Message::Write { request, wait, frame: bytes }).1? {
            Answer::Written(at) => {
                if let Some(in_force) = &self.in_force {
                    in_force.wrote(frame);
                }
                Ok(at)
            }
            Answer::Failed(error) => Err(error),
            _ => Err(self.nonsense()),
        }
    }

    pub(super) fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        if self.info.virtual_time {
            let (state, answer) = self.request(Dir::Read, wait, |request| Message::Read { request, wait });
            return match answer? {
                Answer::Got(meta) => {
                    out.clone_from(&state.exchange.got);
                    Ok(meta)
                }
                Answer::Failed(error) => Err(error),
                _ => Err(self.nonsense()),
            };
        }
        let state = self.state.lock();
        let cancels = state.cancels[Dir::Read as usize];
        let (_, done) = self.wait(state, end_after(wait), |state| {
            if let Some(ended) = &state.exchange.ended {
                return Some(Err(ended.error.clone()));
            }
            if state.cancels[Dir::Read as usize] != cancels {
                return Some(Err(LinkError::Cancelled { dir: Dir::Read }));
            }
            state.exchange.pop(out).map(Ok)
        });
        done.unwrap_or_else(|| Err(timeout(Dir::Read, wait)))
    }

    pub(super) fn nonsense(&self) -> LinkError {
        LinkError::Lost { name: self.info.name.clone(), reason: "its server answers something else".into() }
    }
}

/// Whether a call is under way; the caller is in none.
const fn is_called(state: &State) -> bool {
    state.receiving || state.followers > 0 || state.exchange.request.is_some()
}

/// When a wait ends that begins now; `None`: never.
fn end_after(wait: Wait) -> Option<Instant> {
    match wait {
        Wait::Forever => None,
        Wait::Now => Some(Instant::now()),
        Wait::For(limit) => Instant::now().checked_add(limit),
    }
}
