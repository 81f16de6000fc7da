//! What a server's threads share: the board, its clients, who writes.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use parking_lot::{Condvar, Mutex};

use super::ServeOptions;
use super::client::Client;
use super::seat::Queue;
use crate::ecm::Watch;
use crate::link::tcp::wire::{Counts, End, Message, Refusal, Role, TEXT_MAX, Welcome};
use crate::link::tcp::{Channel, PROOF_LEN};
use crate::link::{KnownNetwork, Link, LinkError, LinkInfo, ReadMeta, Stamp, Wait};
use crate::port::notes::Notes;
use crate::sk::Frame;

/// The board while it is there.
pub(super) struct Board {
    pub(super) link: Arc<dyn Link>,
    pub(super) info: LinkInfo,
    /// What the link knows of the network.
    known: KnownNetwork,
    /// What passing frames say; nothing if the link does not know how wide slots are.
    watch: Mutex<Watch>,
    /// Time and number of the newest report, and reports dropped before the server.
    newest: AtomicU64,
    next: AtomicU64,
    dropped: AtomicU64,
    /// Time of the board on virtual time, as it was known last.
    clock: AtomicU64,
}

impl Board {
    /// Hands a frame over and follows it.
    pub(super) fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let at = self.link.write(frame, wait)?;
        if let Some(size) = self.info.slot {
            self.watch.lock().command(frame, size, at);
        }
        Ok(at)
    }

    /// Time of the board on virtual time; `None` on the real clock, and if it cannot be told. It asks the link, so no lock is held
    /// meanwhile that others need.
    pub(super) fn now(&self) -> Option<Stamp> {
        if !self.info.virtual_time {
            return None;
        }
        let now = self.link.pass(Duration::ZERO).ok().flatten();
        if let Some(now) = now {
            self.clock.store(now.0, Ordering::Relaxed);
        }
        now
    }

    /// As [`now`](Self::now), as it was known last, without asking the link; on the real clock the time of the newest report.
    fn known_now(&self) -> Stamp {
        let known = if self.info.virtual_time { &self.clock } else { &self.newest };
        Stamp(known.load(Ordering::Relaxed))
    }

    pub(super) fn watch(&self) -> Watch {
        self.watch.lock().clone()
    }

    /// What clients are told of the network: what `said` says, what frames have shown, what the link knows, what its name says.
    fn network(&self, said: &KnownNetwork) -> KnownNetwork {
        let shown = self
            .watch
            .lock()
            .config()
            .map(|config| KnownNetwork::of_slaves(config.slaves.iter().map(ToString::to_string)));
        let known = said.clone().or(shown.unwrap_or_default()).or(self.known.clone());
        // Half a list would be another one.
        let whole = |text: String| if text.len() > TEXT_MAX { String::new() } else { text };
        KnownNetwork { slaves: whole(known.slaves), counts_per_unit: whole(known.counts_per_unit) }
    }

    pub(super) fn counts(&self) -> Counts {
        let stats = self.link.stats();
        Counts { reports_dropped: stats.reports_dropped, board: stats.board }
    }

    fn saw(&self, frame: &Frame, meta: ReadMeta) {
        if let Some(size) = self.info.slot {
            let mut watch = self.watch.lock();
            if meta.sequence > self.next.load(Ordering::Relaxed) {
                watch.missed();
            }
            watch.report(frame, size, meta.at);
        }
        self.newest.store(meta.at.0, Ordering::Relaxed);
        self.next.store(meta.sequence.saturating_add(1), Ordering::Relaxed);
        self.dropped.store(meta.dropped, Ordering::Relaxed);
    }
}

enum Place {
    Here(Arc<Board>),
    Away(String),
}

struct State {
    place: Place,
    clients: Vec<Arc<Client>>,
    /// Who writes, in words.
    writer: Option<String>,
    /// The server's own seat, while it writes itself.
    seat: Option<Arc<Queue>>,
    is_stopping: bool,
    is_over: bool,
}

/// What the threads of a server share. Its lock is held for moments: no call into a link, into a function of the program's or into
/// a file is made under it.
pub(super) struct Hub {
    pub(super) options: ServeOptions,
    /// What people are told. No thread that has to do with the board or a client calls [`ServeOptions::tell`] itself.
    pub(super) notes: Notes<String>,
    state: Mutex<State>,
    changed: Condvar,
}

/// A client, and the board it is a client of.
pub(super) type Joined = (Arc<Client>, Arc<Board>);

/// Who wants to be a client.
pub(super) struct Guest<'a> {
    pub(super) who: String,
    pub(super) role: Role,
    pub(super) keepalive: Duration,
    pub(super) proof: &'a [u8; PROOF_LEN],
    /// `None`: what it gets is kept in memory.
    pub(super) channel: Option<Channel>,
}

impl Hub {
    pub(super) fn new(options: ServeOptions) -> Self {
        let place = Place::Away("it is being opened".to_owned());
        let (clients, writer, seat) = (Vec::with_capacity(options.max_clients), None, None);
        let state = State { place, clients, writer, seat, is_stopping: false, is_over: false };
        Self { options, notes: Notes::default(), state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Notes a line for a person; never waits for one.
    pub(super) fn tell(&self, line: &str) {
        self.notes.tell(line.to_owned());
    }

    /// The board is there.
    pub(super) fn attach(&self, link: Arc<dyn Link>) -> Arc<Board> {
        let info = link.info();
        let known = link.network().unwrap_or_default().or(KnownNetwork::of_sim(&info.name));
        let board = Arc::new(Board {
            newest: AtomicU64::new(info.opened_at.0),
            clock: AtomicU64::new(info.opened_at.0),
            next: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
            watch: Mutex::default(),
            known,
            info,
            link,
        });
        self.state.lock().place = Place::Here(Arc::clone(&board));
        board
    }

    /// The board is gone: every client is told so.
    pub(super) fn lose(&self, board: &Arc<Board>, error: &LinkError) {
        let reason = match error {
            LinkError::Lost { reason, .. } => reason.to_string(),
            other => other.to_string(),
        };
        let mut state = self.state.lock();
        if !is_here(&state.place, board) {
            return;
        }
        for client in &state.clients {
            client.finish(End::Lost, &reason);
        }
        let line = format!("the board is gone: {reason}");
        state.place = Place::Away(reason);
        drop(state);
        self.changed.notify_all();
        self.tell(&line);
    }

    /// Whether that board is still there.
    pub(super) fn has(&self, board: &Arc<Board>) -> bool {
        is_here(&self.state.lock().place, board)
    }

    /// Takes a client in with its channel, and welcomes it; or says why not.
    pub(super) fn join(&self, guest: &mut Guest<'_>) -> Result<Joined, (Refusal, String)> {
        let mut state = self.state.lock();
        let board = match &state.place {
            _ if state.is_stopping => return Err((Refusal::NoBoard, "it is being stopped".to_owned())),
            Place::Away(reason) => {
                let reason = reason.clone();
                return Err((Refusal::NoBoard, reason));
            }
            Place::Here(board) => Arc::clone(board),
        };
        // Readers leave a place to the one who writes.
        let kept = guest.role == Role::Reader && state.writer.is_none() && self.options.max_clients > 1;
        if state.clients.len() + usize::from(kept) >= self.options.max_clients {
            return Err((Refusal::Full, String::new()));
        }
        if let (Role::Writer, Some(who)) = (guest.role, &state.writer) {
            let who = who.clone();
            return Err((Refusal::HasWriter, who));
        }
        let Guest { role, keepalive, proof, .. } = *guest;
        let (who, channel) = (std::mem::take(&mut guest.who), guest.channel.take());
        if role == Role::Writer {
            state.writer = Some(who.clone());
        }
        let client = Arc::new(Client::new(who, role, keepalive, channel, board.dropped.load(Ordering::Relaxed)));
        let network = board.network(&self.options.network);
        client.reply(&Message::Welcome(Welcome {
            proof,
            slot: board.info.slot,
            virtual_time: board.info.virtual_time,
            now: board.known_now(),
            sequence: board.next.load(Ordering::Relaxed),
            board: &board.info.name,
            slaves: &network.slaves,
            counts_per_unit: &network.counts_per_unit,
        }));
        state.clients.push(Arc::clone(&client));
        Ok((client, board))
    }

    /// A client is gone. A writer that is not `trusted` leaves its place to the server, which has to give it back
    /// ([`leave_seat`](Self::leave_seat)).
    pub(super) fn leave(&self, client: &Arc<Client>, is_trusted: bool) -> Option<Arc<Queue>> {
        let mut state = self.state.lock();
        state.clients.retain(|other| !Arc::ptr_eq(other, client));
        if client.role != Role::Writer {
            return None;
        }
        state.writer = None;
        if is_trusted {
            return None;
        }
        let queue = Arc::new(Queue::default());
        state.writer = Some(format!("the server itself, which brings axes to a standstill after {}", client.who));
        state.seat = Some(Arc::clone(&queue));
        Some(queue)
    }

    pub(super) fn leave_seat(&self) {
        let mut state = self.state.lock();
        (state.writer, state.seat) = (None, None);
    }

    /// A report for everybody, but not for a writer that gets it as an answer.
    pub(super) fn publish(&self, board: &Board, frame: &Frame, meta: ReadMeta) {
        let state = self.state.lock();
        // In one with handing it out: a client that comes is told the number of the first report that it gets.
        board.saw(frame, meta);
        for client in &state.clients {
            if !(board.info.virtual_time && client.role == Role::Writer) {
                client.report(frame, meta);
            }
        }
        if let Some(queue) = state.seat.as_ref().filter(|_| !board.info.virtual_time) {
            queue.push(frame, meta);
        }
    }

    /// No more clients; those there are get told.
    pub(super) fn stop(&self) {
        let mut state = self.state.lock();
        state.is_stopping = true;
        for client in &state.clients {
            client.finish(End::Stopped, "");
        }
    }

    pub(super) fn is_stopping(&self) -> bool {
        self.state.lock().is_stopping
    }

    /// Nobody needs the board any more.
    pub(super) fn end(&self) {
        let board = {
            let mut state = self.state.lock();
            state.is_over = true;
            match &state.place {
                Place::Here(board) => Some(Arc::clone(board)),
                Place::Away(_) => None,
            }
        };
        self.changed.notify_all();
        if let Some(board) = board {
            board.link.cancel(crate::link::Dir::Read);
        }
    }

    pub(super) fn is_over(&self) -> bool {
        self.state.lock().is_over
    }

    /// Waits until something of that changes, at most `limit`.
    pub(super) fn rest(&self, limit: Duration) {
        let mut state = self.state.lock();
        if !state.is_over {
            self.changed.wait_for(&mut state, limit);
        }
    }
}

fn is_here(place: &Place, board: &Arc<Board>) -> bool {
    matches!(place, Place::Here(here) if Arc::ptr_eq(here, board))
}
