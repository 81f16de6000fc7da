//! The client's end while it is open: whose call receives, who may send, what a wait ends with.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::DEAD_AFTER;
use super::channel::{Came, Channel, Out};
use super::connect::{Connected, connect, until_closed};
use super::exchange::{Answer, Exchange};
use super::failure::timeout;
use super::inbox::Inbox;
use super::options::TcpOptions;
use super::wire::{Counts, End, Message, Role};
use crate::link::options::CommonOptions;
use crate::link::uri::LinkUri;
use crate::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::Frame;

/// While nobody waits in a call, somebody looks at least this often what came. \[OURS]
const LOOK: Duration = Duration::from_millis(20);
/// How long closing waits for the server to have noticed. \[OURS]
const CLOSE_LIMIT: Duration = Duration::from_secs(1);

/// A link to a board that is served.
pub struct TcpLink {
    shared: Arc<Shared>,
    keeper: Mutex<Option<JoinHandle<()>>>,
}

struct Shared {
    info: LinkInfo,
    board: String,
    role: Role,
    keepalive: Duration,
    channel: Channel,
    out: Mutex<Sender>,
    inbox: Mutex<Inbox>,
    state: Mutex<State>,
    changed: Condvar,
    over: Condvar,
    counts: Calls,
}

struct Sender {
    out: Out,
    last: Instant,
}

struct State {
    exchange: Exchange,
    /// Somebody is receiving.
    receiving: bool,
    /// Others wait for what it receives.
    followers: u32,
    cancels: [u64; 2],
}

#[derive(Default)]
struct Calls {
    written: AtomicU64,
    read: AtomicU64,
    write_errors: AtomicU64,
    read_errors: AtomicU64,
}

impl TcpLink {
    /// Connects to the server that the URI names.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`], which says what the server or the system said; [`LinkError::InUse`] if another client is
    /// the writer, and who; [`LinkError::Io`].
    pub fn connect(uri: &LinkUri, options: &TcpOptions, common: &CommonOptions) -> Result<Self, LinkError> {
        let name = uri.to_string();
        let Connected { channel, mut inbox, out, slot, virtual_time, now, sequence, board } = connect(&name, options)?;
        // For a reader time passes by itself: the writer lets it.
        let virtual_time = virtual_time && options.role == Role::Writer;
        let info = LinkInfo {
            name: name.clone(),
            slot: common.slot.or(slot),
            virtual_time,
            opened_at: now,
            read_wait: common.read_wait(),
            write_wait: common.write_wait(),
        };
        let mut exchange = Exchange::new(name, sequence, common.queue, virtual_time.then_some(now));
        // What came with the welcome.
        exchange.take_all(&mut inbox);
        let shared = Arc::new(Shared {
            info,
            board,
            role: options.role,
            keepalive: options.keepalive,
            channel,
            out: Mutex::new(Sender { out, last: Instant::now() }),
            inbox: Mutex::new(inbox),
            state: Mutex::new(State { exchange, receiving: false, followers: 0, cancels: [0; 2] }),
            changed: Condvar::new(),
            over: Condvar::new(),
            counts: Calls::default(),
        });
        let keeper = std::thread::Builder::new().name("ecmsk-tcp".into()).spawn({
            let shared = Arc::clone(&shared);
            move || shared.keep()
        });
        let keeper = keeper.map_err(|error| LinkError::Io {
            what: format!("start the thread of `{}`", shared.info.name),
            message: format!("{error}; free some threads (`ulimit -u`) and open it again"),
        })?;
        Ok(Self { shared, keeper: Mutex::new(Some(keeper)) })
    }

    /// The server's own link, as it calls it.
    pub fn board(&self) -> &str {
        &self.shared.board
    }
}

impl Shared {
    /// How long the other end may say nothing.
    fn patience(&self) -> Duration {
        self.keepalive * DEAD_AFTER
    }

    /// The thread in the background: receives while nobody waits, says that the client is there, notices that the server
    /// is not.
    fn keep(&self) {
        let look = LOOK.min(self.keepalive / 4);
        let mut state = self.state.lock();
        while state.exchange.ended.is_none() {
            self.over.wait_for(&mut state, look);
            if !state.receiving {
                state = self.lead(state, Some(Instant::now()));
            }
            let silent = state.exchange.heard.elapsed();
            if silent > self.patience() {
                state.exchange.lose(format!("no word of its server for {silent:?}"));
            }
            if state.exchange.ended.is_none() {
                MutexGuard::unlocked(&mut state, || self.ping());
            }
        }
        drop(state);
        self.changed.notify_all();
        self.channel.wake();
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
        let mut came = self.channel.receive(&mut inbox)?;
        if came == Came::Nothing {
            let left = until.map(|until| until.saturating_duration_since(Instant::now()));
            if left == Some(Duration::ZERO) {
                return Ok(());
            }
            self.channel.wait(false, left)?;
            came = self.channel.receive(&mut inbox)?;
        }
        let mut state = self.state.lock();
        match came {
            Came::Nothing => {}
            Came::Bytes => {
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
    fn request<'a>(
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

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        if self.role == Role::Reader {
            return Err(LinkError::Io {
                what: format!("write to `{}`", self.info.name),
                message: "it is a reader's link; open it with role=writer".to_owned(),
            });
        }
        let frame = frame.bytes();
        match self.request(Dir::Write, wait, |request| Message::Write { request, wait, frame }).1? {
            Answer::Written(at) => Ok(at),
            Answer::Failed(error) => Err(error),
            _ => Err(self.nonsense()),
        }
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
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

    fn nonsense(&self) -> LinkError {
        LinkError::Lost { name: self.info.name.clone(), reason: "its server answers something else".into() }
    }
}

/// When a wait ends that begins now; `None`: never.
fn end_after(wait: Wait) -> Option<Instant> {
    match wait {
        Wait::Forever => None,
        Wait::Now => Some(Instant::now()),
        Wait::For(limit) => Instant::now().checked_add(limit),
    }
}

fn counted<T>(done: &AtomicU64, failed: &AtomicU64, result: Result<T, LinkError>) -> Result<T, LinkError> {
    let counter = if result.is_ok() { done } else { failed };
    counter.fetch_add(1, Ordering::Relaxed);
    result
}

impl Link for TcpLink {
    fn info(&self) -> LinkInfo {
        self.shared.info.clone()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let counts = &self.shared.counts;
        counted(&counts.written, &counts.write_errors, self.shared.write(frame, wait))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let counts = &self.shared.counts;
        counted(&counts.read, &counts.read_errors, self.shared.read(out, wait))
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        self.check()?;
        if !self.shared.info.virtual_time {
            return Ok(None);
        }
        // Nobody else lets time pass, so what it was after the last request it is still.
        if time.is_zero()
            && let Some(now) = self.shared.state.lock().exchange.now
        {
            return Ok(Some(now));
        }
        let ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        let wait = Wait::For(self.shared.patience());
        match self.shared.request(Dir::Read, wait, |request| Message::Pass { request, ns }).1? {
            Answer::Passed(now) => Ok(now),
            Answer::Failed(error) => Err(error),
            _ => Err(self.shared.nonsense()),
        }
    }

    fn cancel(&self, dir: Dir) {
        self.shared.state.lock().cancels[dir as usize] += 1;
        self.shared.changed.notify_all();
        self.shared.channel.wake();
    }

    fn close(&self) {
        let shared = &self.shared;
        let first = {
            let mut state = shared.state.lock();
            let was_open = state.exchange.ended.is_none();
            let closed = matches!(&state.exchange.ended, Some(ended) if ended.error == LinkError::Closed);
            state.exchange.ended = Some(super::exchange::Ended { error: LinkError::Closed, unsure: false });
            was_open.then_some(()).or((!closed).then_some(())).map(|()| was_open)
        };
        let Some(was_open) = first else { return };
        shared.over.notify_all();
        shared.changed.notify_all();
        shared.channel.wake();
        if was_open {
            let mut sender = shared.out.lock();
            let bye = Message::Bye { end: End::Closed, text: "" };
            let deadline = Instant::now() + CLOSE_LIMIT;
            let said = shared
                .channel
                .stage(&bye, &mut sender.out)
                .and_then(|()| shared.channel.flush(&mut sender.out, deadline));
            shared.channel.end(false);
            if said.is_ok() {
                // Once it has closed its end, the next client may be the writer.
                until_closed(&shared.channel, &mut shared.inbox.lock(), deadline);
            }
        }
        shared.channel.end(true);
        if let Some(keeper) = self.keeper.lock().take() {
            // It ends at its next look.
            let _ = keeper.join();
        }
    }

    fn check(&self) -> Result<(), LinkError> {
        match &self.shared.state.lock().exchange.ended {
            None => Ok(()),
            Some(ended) => Err(ended.error.clone()),
        }
    }

    fn stats(&self) -> LinkStats {
        let shared = &self.shared;
        let wait = Wait::For(shared.patience());
        let (state, asked) = shared.request(Dir::Read, wait, |request| Message::Count { request });
        // Without an answer those of the last time are what is known.
        let counts = match asked {
            Ok(Answer::Counted(counts)) => counts,
            _ => Counts { ..state.exchange.counts },
        };
        let here = state.exchange.dropped();
        drop(state);
        let count = |count: &AtomicU64| count.load(Ordering::Relaxed);
        LinkStats {
            written: count(&shared.counts.written),
            read: count(&shared.counts.read),
            reports_dropped: counts.reports_dropped + here,
            write_errors: count(&shared.counts.write_errors),
            read_errors: count(&shared.counts.read_errors),
            record_dropped: 0,
            faults: Default::default(),
            board: counts.board,
        }
    }
}

impl Drop for TcpLink {
    fn drop(&mut self) {
        self.close();
    }
}
