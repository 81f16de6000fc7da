//! How the program's threads and the background thread share a client's connection: which thread receives, which one
//! sends, and how waits end.

use std::time::{Duration, Instant};

use parking_lot::Mutex;

use super::channel::{Came, Channel, Out};
use super::exchange::{Answer, Exchange};
use super::hang::{CallMonitor, MotionInForce, StuckCall};
use super::inbox::Inbox;
use super::wire::{Message, Role};
use crate::link::call_counts::CallCounts;
use crate::link::{Dir, KnownNetwork, LinkError, LinkInfo, ReadMeta, Stamp, Wait};
use crate::sk::Frame;
use crate::span::Span;
#[cfg(unix)]
use crate::threads::LetGo;
use crate::threads::sync::{self, Condvar, MutexGuard};
use crate::threads::{CallingThread, WaitQueue};

/// Whether a call that waits for a message receives bytes from the socket itself, instead of waiting for the background thread.
/// This saves a thread switch. On Windows programs end their threads by force (`TerminateThread`), and bytes would be lost with
/// a thread that ends while it receives.
const CALLS_RECEIVE: bool = cfg!(not(windows));
/// How often the background thread receives while no call waits. \[OURS]
const IDLE_POLL_INTERVAL: Duration = Duration::from_millis(20);

/// The part of a `tcp:` link that the program's threads and the background thread share.
pub(super) struct Shared {
    pub(super) info: LinkInfo,
    /// The URI with which the server has opened the board.
    pub(super) board: String,
    /// The slaves and the units of their axes, as the server knows them.
    pub(super) network: KnownNetwork,
    pub(super) role: Role,
    pub(super) keepalive: Duration,
    /// The slaves with a velocity or torque that the program has commanded and no later command has ended, for detecting a
    /// program that has stopped calling (`hang_ms=`); `None`: such a program is not detected.
    pub(super) in_force: Option<MotionInForce>,
    /// Closes the socket in forked children, by its number. Declared before the channel, so that it is dropped first: when the
    /// channel has closed the socket, the number may belong to another file.
    #[cfg(unix)]
    pub(super) _let_go: LetGo,
    pub(super) channel: Channel,
    /// The buffers for sending, and the time of the last message. Every wait for this lock has a timeout, after which the
    /// connection counts as lost: a thread that was ended by force while it sent keeps the lock.
    pub(super) out: Mutex<Sender>,
    /// Locked for short times only: no thread makes a system call while it holds this lock.
    pub(super) state: sync::Mutex<State>,
    /// Wakes the calls that wait for a message while another thread receives it.
    pub(super) changed: WaitQueue,
    /// Wakes the background thread, so that it ends, when the exchange with the server has ended.
    pub(super) over: Condvar,
    pub(super) counts: CallCounts,
}

/// The buffers for sending, and the time of the last message that was sent.
pub(super) struct Sender {
    pub(super) out: Out,
    pub(super) last: Instant,
}

/// The state of a link behind the lock [`Shared::state`].
pub(super) struct State {
    pub(super) exchange: Exchange,
    /// The thread that receives for all threads; `None`: no thread is receiving.
    pub(super) receiver: Option<CallingThread>,
    /// The received bytes; `None` while the receiving thread takes bytes from the connection. If that thread is ended
    /// by force meanwhile, the bytes are lost and the beginning of the next message is unknown, so the link ends.
    pub(super) inbox: Option<Inbox>,
    /// The threads that wait for a message while another thread receives for all.
    pub(super) waiting: Vec<CallingThread>,
    /// How often waiting reads and writes were cancelled so far, one count for each direction. A call that waits has been
    /// cancelled if the count has changed since the call began.
    pub(super) cancels: [u64; 2],
}

impl State {
    /// Whether a thread other than the calling one receives for all. If the calling thread itself is the receiver, this
    /// call comes from a signal handler that has interrupted it. Then this call receives, because the interrupted call
    /// cannot go on.
    fn is_received_by_another(&self) -> bool {
        self.receiver.is_some_and(|receiver| receiver != CallingThread::current())
    }

    /// Returns an error if the exchange has ended, or if calls in this direction were cancelled after the caller read the count
    /// `cancels`.
    fn check(&self, dir: Dir, cancels: u64) -> Result<(), LinkError> {
        self.exchange.check()?;
        if self.cancels[dir as usize] == cancels { Ok(()) } else { Err(LinkError::Cancelled { dir }) }
    }
}

impl Shared {
    pub(super) fn state(&self) -> MutexGuard<'_, State> {
        sync::lock(&self.state)
    }

    /// How long the other end may send nothing before the connection counts as dead.
    pub(super) fn patience(&self) -> Duration {
        super::patience(self.keepalive)
    }

    /// The background thread: it receives while no call waits, and sends keep-alive messages. It ends the connection if the
    /// server has gone, or if the program has stopped calling while axes move.
    pub(super) fn run_background(&self) {
        let look = IDLE_POLL_INTERVAL.min(self.keepalive / 4);
        let mut idle = CallMonitor::new(Instant::now());
        let mut stuck = StuckCall::default();
        let mut state = self.state();
        while state.exchange.ended.is_none() {
            if CALLS_RECEIVE {
                state = sync::wait_for(&self.over, state, look);
            }
            self.forget_callers_that_are_gone(&mut state);
            if state.receiver.is_none() {
                let until = Instant::now() + if CALLS_RECEIVE { Duration::ZERO } else { look };
                state = self.receive_for_all(state, Some(until));
            }
            let silent = state.exchange.heard.elapsed();
            if silent > self.patience() {
                state.exchange.lose(format!("no word of its server for {}", Span(silent)));
            }
            if let Some(reason) = self.in_force.as_ref().and_then(|in_force| {
                let now = Instant::now();
                let is_in_call = is_call_in_progress(&state);
                let idle = idle.look(self.calls(&state), is_in_call, now, in_force);
                let takes_nothing = state.receiver.is_some() && self.channel.has_unread();
                let stuck = stuck.look(takes_nothing, state.exchange.heard, now, in_force);
                let made = idle.map(|silent| format!("the program made no call for {}", Span(silent)));
                made.or_else(|| {
                    stuck.map(|silent| format!("a call of the program has stood still for {}", Span(silent)))
                })
            }) {
                let reason = format!("{reason} while axes move by its velocity or torque (hang_ms=); open it again");
                state.exchange.lose(reason.clone());
                // The connection ends before the warning is written, so that the server stops the axes at once.
                self.channel.end(true);
                log::warn!("`{}`: {reason}", self.info.name);
            }
            if state.exchange.ended.is_none() {
                drop(state);
                self.ping();
                state = self.state();
            }
        }
        let is_lost = state.exchange.ended.as_ref().is_some_and(|ended| !matches!(ended.error, LinkError::Closed));
        drop(state);
        if is_lost {
            // Ending the connection lets the server stop the axes now, instead of after four keep-alive times without a
            // message.
            self.channel.end(true);
        }
        self.changed.notify_all();
        self.channel.wake();
    }

    /// The number of calls that the program has made so far. If it stops rising, the program has stopped calling
    /// (`hang_ms=`).
    fn calls(&self, state: &State) -> u64 {
        self.counts.ended() + state.exchange.next_request
    }

    fn ping(&self) {
        let Some(mut sender) = self.out.try_lock() else { return };
        let Sender { out, last } = &mut *sender;
        if last.elapsed() >= self.keepalive / 2 && out.is_empty() {
            *last = Instant::now();
            // An error of the connection also occurs when receiving, where it is handled.
            let _ = self.channel.stage(&Message::Ping, out).and_then(|()| self.channel.push(out));
        }
    }

    /// Cleans up after threads that the program has ended by force in the middle of a call.
    fn forget_callers_that_are_gone(&self, state: &mut State) {
        if state.receiver.is_some_and(|caller| caller.is_gone()) {
            state.receiver = None;
            if state.inbox.is_none() {
                state.exchange.lose("a thread of the program was ended while it received; open it again");
            }
            self.changed.notify_all();
        }
        state.waiting.retain(|caller| !caller.is_gone());
        // Only one request may be in progress. The request of a thread that was ended by force stays in progress until
        // the server has answered it, and is then removed here.
        if state.exchange.request.as_ref().is_some_and(|request| request.answer.is_some() && request.caller.is_gone()) {
            state.exchange.request = None;
            self.changed.notify_all();
        }
    }

    /// Encodes a message and sends all its bytes.
    fn send(&self, message: &Message<'_>) -> std::io::Result<()> {
        // A thread that was ended by force while it was sending keeps the lock for ever.
        let mut sender = self.out.try_lock_for(self.patience()).ok_or(std::io::ErrorKind::TimedOut)?;
        let Sender { out, last } = &mut *sender;
        *last = Instant::now();
        self.channel.stage(message, out)?;
        self.channel.flush(out, *last + self.patience())
    }

    /// Receives for all waiting threads. Ends when a message has arrived, when [`Channel::wake`] is called, or at the
    /// time `until`.
    fn receive_for_all<'a>(
        &'a self,
        mut state: MutexGuard<'a, State>,
        until: Option<Instant>,
    ) -> MutexGuard<'a, State> {
        let own = CallingThread::current();
        let before = state.receiver.replace(own);
        drop(state);
        let (mut state, came) = self.receive(until);
        if state.receiver == Some(own) {
            // If this call comes from a signal handler that has interrupted the receiving thread, the interrupted call
            // is the receiver again, and goes on when the handler returns. If the handler does not return, no other
            // thread receives: otherwise `hang_ms=` would not detect that the program hangs.
            state.receiver = before.filter(|before| *before == own);
        }
        if let Err(error) = came {
            state.exchange.lose(format!("{error}"));
        }
        self.tell_those_who_wait(state)
    }

    /// Wakes the waiting calls. The lock is released first: if the program ends this thread by force while it wakes them, no
    /// lock is left locked.
    fn tell_those_who_wait<'a>(&'a self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        if state.waiting.is_empty() {
            return state;
        }
        drop(state);
        self.changed.notify_all();
        self.state()
    }

    fn receive(&self, until: Option<Instant>) -> (MutexGuard<'_, State>, std::io::Result<()>) {
        let left = until.map(|until| until.saturating_duration_since(Instant::now()));
        let may_wait = left != Some(Duration::ZERO);
        // If the call may wait, usually no bytes have arrived yet, so a system call to receive before the wait would be
        // wasted.
        if !may_wait || self.channel.keeps_some() {
            let (state, came) = self.take_what_came();
            if !may_wait || !matches!(came, Ok(Came::Nothing)) {
                return (state, came.map(|_| ()));
            }
        }
        // The lock is not held during the wait, because the program may end this thread by force there.
        if let Err(error) = self.channel.wait(false, left) {
            return (self.state(), Err(error));
        }
        let (state, came) = self.take_what_came();
        (state, came.map(|_| ()))
    }

    /// Takes the bytes that have arrived, and the messages in them; never waits.
    fn take_what_came(&self) -> (MutexGuard<'_, State>, std::io::Result<Came>) {
        let Some(mut inbox) = self.state().inbox.take() else {
            // There is no inbox: it was lost together with a thread that was ended by force while it received.
            return (self.state(), Ok(Came::Nothing));
        };
        let came = self.channel.receive(&mut inbox);
        let mut state = self.state();
        match came {
            Ok(Came::Bytes | Came::All) => {
                state.exchange.heard = Instant::now();
                state.exchange.take_all(&mut inbox);
            }
            Ok(Came::End) => state.exchange.lose("its server has closed the connection"),
            Ok(Came::Nothing) | Err(_) => {}
        }
        state.inbox = Some(inbox);
        (state, came)
    }

    /// Waits until `look`, which is called after each change of the state, returns a value, or until `until`; then the value is
    /// `None`. If `until` has passed already, messages that have arrived are still received once.
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
            let is_received_by_another = state.is_received_by_another();
            if late && (received || is_received_by_another) {
                return (state, None);
            }
            received = true;
            if CALLS_RECEIVE && !is_received_by_another {
                state = self.receive_for_all(state, until);
                continue;
            }
            let caller = CallingThread::current();
            state.waiting.push(caller);
            let ticket = self.changed.ticket();
            let left = until.map(|until| until.saturating_duration_since(Instant::now()));
            drop(state);
            self.changed.wait(ticket, left);
            state = self.state();
            if let Some(own) = state.waiting.iter().position(|other| *other == caller) {
                state.waiting.swap_remove(own);
            }
        }
    }

    /// Sends a request and waits for its answer. The server applies the timeout `wait`. If it does not answer at all, the wait
    /// ends [`Self::patience`] after that timeout.
    pub(super) fn request<'a>(
        &'a self,
        dir: Dir,
        wait: Wait,
        message: impl FnOnce(u64) -> Message<'a>,
    ) -> (MutexGuard<'a, State>, Result<Answer, LinkError>) {
        self.request_and(dir, wait, message, || ())
    }

    /// As [`Self::request`]. If the server has executed the request, `answered` is called before the request of another
    /// thread can begin, so that these calls come in the order of the requests.
    pub(super) fn request_and<'a>(
        &'a self,
        dir: Dir,
        wait: Wait,
        message: impl FnOnce(u64) -> Message<'a>,
        answered: impl FnOnce(),
    ) -> (MutexGuard<'a, State>, Result<Answer, LinkError>) {
        let limit = wait.deadline();
        let state = self.state();
        let cancels = state.cancels[dir as usize];
        // Only one request may be in progress at a time.
        let (state, turn) = self.wait(state, limit, |state| {
            let checked = state.check(dir, cancels);
            checked.map(|()| state.exchange.may_begin().then(|| state.exchange.begin(dir, wait))).transpose()
        });
        let number = match turn.unwrap_or_else(|| Err(LinkError::timed_out(dir, wait))) {
            Ok(number) => number,
            Err(error) => return (state, Err(error)),
        };
        drop(state);
        let sent = self.send(&message(number));
        let mut state = self.state();
        if let Err(error) = sent {
            // The server executes only requests that it has received completely. It did not receive all of this message, so the
            // request was not executed.
            let error = LinkError::Lost { name: self.info.name.clone(), reason: error.to_string().into() };
            state.exchange.end(error.clone(), false);
            return self.done(state, Err(error));
        }
        let answer_deadline = limit.map(|limit| limit + self.patience());
        let (mut state, mut done) = self.wait(state, answer_deadline, |state| self.answer(state, dir, cancels, false));
        if let Some(Err(None)) = done {
            drop(state);
            // If sending fails, receiving will fail, too, and the error is handled there.
            let _ = self.send(&Message::Cancel { request: number });
            let answer_deadline = Some(Instant::now() + self.patience());
            (state, done) = self.wait(self.state(), answer_deadline, |state| self.answer(state, dir, cancels, true));
        }
        match done {
            Some(Ok(answer)) => {
                answered();
                self.done(state, Ok(answer))
            }
            Some(Err(Some(error))) => {
                // The board has got the frame without its CSP targets. As a CSP target leaves nothing in force, the
                // whole frame is noted.
                if matches!(error, LinkError::BeyondLimit { .. }) {
                    answered();
                }
                self.done(state, Err(error))
            }
            Some(Err(None)) | None => {
                state.exchange.lose("its server does not answer");
                drop(state);
                self.over.notify_all();
                let state = self.state();
                let error = self.ended(&state, dir);
                self.done(state, Err(error))
            }
        }
    }

    /// The answer to the request in progress, or the error that has ended it. `Err(None)`: the request was cancelled.
    fn answer(
        &self,
        state: &mut State,
        dir: Dir,
        cancels: u64,
        cancel_sent: bool,
    ) -> Option<Result<Answer, Option<LinkError>>> {
        if let Some(answer) = state.exchange.request.as_mut().and_then(|request| request.answer.take()) {
            return Some(answer.map_err(Some));
        }
        if state.exchange.ended.is_some() {
            return Some(Err(Some(self.ended(state, dir))));
        }
        (!cancel_sent && dir == Dir::Write && state.cancels[dir as usize] != cancels).then_some(Err(None))
    }

    /// The error of a request that was in progress when the exchange with the server ended: [`LinkError::Unsure`] for a write
    /// that the server may have executed, otherwise the error that ended the exchange.
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

    fn done<'a, T>(&'a self, mut state: MutexGuard<'a, State>, done: T) -> (MutexGuard<'a, State>, T) {
        state.exchange.request = state.exchange.interrupted.take();
        (self.tell_those_who_wait(state), done)
    }

    pub(super) fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        if self.role == Role::Reader {
            return Err(LinkError::Io {
                what: format!("write to `{}`", self.info.name),
                message: "it is a reader's link; open it with role=writer".to_owned(),
            });
        }
        let bytes = frame.bytes();
        let written = || {
            if let Some(in_force) = &self.in_force {
                in_force.wrote(frame);
            }
        };
        let message = |request| Message::Write { request, wait, frame: bytes };
        match self.request_and(Dir::Write, wait, message, written).1? {
            Answer::Written(at) => Ok(at),
            _ => Err(self.unexpected_answer()),
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
                _ => Err(self.unexpected_answer()),
            };
        }
        let state = self.state();
        let cancels = state.cancels[Dir::Read as usize];
        let look = |state: &mut State| state.check(Dir::Read, cancels).map(|()| state.exchange.pop(out)).transpose();
        let done = self.wait(state, wait.deadline(), look).1;
        done.unwrap_or_else(|| Err(LinkError::timed_out(Dir::Read, wait)))
    }

    pub(super) fn unexpected_answer(&self) -> LinkError {
        LinkError::Lost { name: self.info.name.clone(), reason: "its server answers something else".into() }
    }
}

/// Whether a thread of the program is in a call of this link.
fn is_call_in_progress(state: &State) -> bool {
    state.receiver.is_some() || !state.waiting.is_empty() || state.exchange.request.is_some()
}
