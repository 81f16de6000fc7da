//! The state that the threads of a server share: the board, its clients, and which of them is the writer.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};

use super::board::Board;
use super::client::Client;
use super::report_queue::ReportQueue;
use super::{OnVanish, ServeOptions};
use crate::link::{Link, LinkError, ReadMeta, limits};
use crate::notes::Notes;
use crate::port::standstill::Standstill;
use crate::sk::{Frame, MasterState};
use crate::tcp::wire::{End, Message, Refusal, Role, Welcome};
use crate::tcp::{Channel, PROOF_LEN, Secret};

/// If a stop of axes fails although the board is present, the server repeats it after this time; it makes at most
/// [`TRIES_MAX`] attempts in all. \[OURS]
const RETRY_AFTER: Duration = Duration::from_secs(1);
pub(super) const TRIES_MAX: u32 = 6;
/// How many clients that ask for a stop are served at once, beside the other clients. \[OURS]
const STOPPERS_MAX: usize = 4;
/// The most clients at a time that ask for the machine file. \[OURS]
const ASKERS_MAX: usize = 16;

struct State {
    /// The board, or the reason why none is open.
    board: Result<Arc<Board>, String>,
    clients: Vec<Arc<Client>>,
    /// The name of the client that is the writer. While the server itself is the writer, this is a text that says so,
    /// and after which client it stops the axes. `None`: there is no writer. The text of a refusal names the writer.
    writer: Option<String>,
    /// The reports that the server itself reads while it is the writer: it needs them to bring the axes of a vanished
    /// writer to a standstill. `None`: the server is not the writer.
    server_reports: Option<Arc<ReportQueue>>,
    /// How many attempts of the server to bring the axes to a standstill have ended, and the result of the newest
    /// attempt.
    standstills: u64,
    newest_standstill: Option<Standstill>,
    /// How many stops that clients have asked for are not answered yet. Meanwhile no client becomes the writer, because
    /// its frames could move the axes before the answer says that they stand.
    stops: usize,
    /// The axes that the server still has to stop: an attempt has failed and is repeated, or the board is lost and the
    /// axes are stopped when it is back.
    left_moving: Option<LeftMoving>,
    is_stopping: bool,
    is_over: bool,
}

/// Axes that may move and that the server has to stop: their writer has not closed its link, or a client has asked for
/// a stop.
pub(super) struct LeftMoving {
    /// For the log: the name of the writer, or the stop that a client has asked for.
    pub(super) who: String,
    pub(super) on_vanish: OnVanish,
    /// How many attempts to stop the axes have failed, and when the newest one has failed. The number restarts at 0
    /// when a lost board is back.
    pub(super) tries: u32,
    pub(super) failed_at: Option<Instant>,
}

impl LeftMoving {
    pub(super) const fn new(who: String, on_vanish: OnVanish) -> Self {
        Self { who, on_vanish, tries: 0, failed_at: None }
    }
}

impl State {
    /// Makes the server itself the writer, until [`Hub::end_standstill`]. Returns the queue of reports for it.
    fn begin_standstill(&mut self, why: &str) -> Arc<ReportQueue> {
        let queue = Arc::new(ReportQueue::default());
        self.writer = Some(format!("the server itself, which brings axes to a standstill {why}"));
        self.server_reports = Some(Arc::clone(&queue));
        queue
    }

    /// How many clients have this role, without those whose connection is being ended.
    fn count(&self, role: Role) -> usize {
        self.clients.iter().filter(|client| client.role == role && client.dismissal().is_none()).count()
    }

    /// Makes room for a client that asks for a stop or for the machine file: disconnects the oldest client with the
    /// same role for which no stop is being carried out. Returns whether there is such a client.
    fn make_room(&self, role: Role) -> bool {
        let is_idle =
            |client: &&Arc<Client>| client.role == role && client.dismissal().is_none() && !client.is_stopping();
        let oldest = self.clients.iter().find(is_idle);
        oldest
            .inspect(|client| client.dismiss(End::Broken, "it asked for nothing, and made room for another"))
            .is_some()
    }
}

/// The progress of a stop that a client has asked for. Dropping this value ends the stop.
pub(super) struct StopProgress {
    /// The number of finished attempts to stop the axes (`State::standstills`) when this stop began to wait for an attempt,
    /// or began one itself. It waits until a later attempt has finished. `None`: neither has happened yet.
    since: Option<u64>,
    /// The name of the writer that was overruled; empty if there was none.
    pub(super) writer: String,
    by: Arc<Client>,
    hub: Arc<Hub>,
}

impl Drop for StopProgress {
    fn drop(&mut self) {
        self.by.set_stopping(false);
        self.hub.state.lock().stops -= 1;
    }
}

/// The next step of a stop that a client has asked for.
pub(super) enum StopStep {
    /// Another thread brings the axes to a standstill.
    Wait,
    /// The caller has to bring the axes to a standstill, and reads these reports for that.
    Brake(Arc<ReportQueue>),
    /// The stop has ended.
    Done(Standstill),
}

/// The state that the threads of a server share. Its lock is held only briefly: a thread that holds it calls no link
/// and none of the caller's functions (such as [`ServeOptions::tell`]), and uses no file.
pub(super) struct Hub {
    pub(super) options: ServeOptions,
    /// The log. No thread that serves the board or a client calls [`ServeOptions::tell`] itself.
    pub(super) notes: Notes<String>,
    /// The secret for new connections: that of the options, or one that has replaced it.
    secret: Mutex<Option<Secret>>,
    /// The number of clients, which can be read without a lock.
    client_count: Arc<AtomicUsize>,
    state: Mutex<State>,
    changed: Condvar,
}

/// A client that has just joined, and the board that it joined.
pub(super) type Joined = (Arc<Client>, Arc<Board>);

/// A connection that asks to become a client.
pub(super) struct Joining<'a> {
    pub(super) who: String,
    pub(super) role: Role,
    pub(super) keepalive: Duration,
    pub(super) proof: &'a [u8; PROOF_LEN],
    /// The client's connection; `None`: messages to the client are kept in memory, for tests.
    pub(super) channel: Option<Channel>,
}

impl Hub {
    pub(super) fn new(options: ServeOptions) -> Self {
        let board = Err("it is being opened".to_owned());
        let clients = Vec::with_capacity(options.max_clients.saturating_add(STOPPERS_MAX + ASKERS_MAX));
        let state = State {
            board,
            clients,
            writer: None,
            server_reports: None,
            standstills: 0,
            newest_standstill: None,
            stops: 0,
            left_moving: None,
            is_stopping: false,
            is_over: false,
        };
        Self {
            secret: Mutex::new(options.secret.clone()),
            options,
            notes: Notes::default(),
            client_count: Arc::default(),
            state: Mutex::new(state),
            changed: Condvar::new(),
        }
    }

    /// The secret that a new connection has to know; `None`: no secret is needed.
    pub(super) fn secret(&self) -> Option<Secret> {
        self.secret.lock().clone()
    }

    /// Replaces the secret for new connections, if the server has one. Returns whether the server has a secret.
    pub(super) fn set_secret(&self, new: Secret) -> bool {
        let mut secret = self.secret.lock();
        let has_one = secret.is_some();
        if has_one {
            *secret = Some(new);
        }
        has_one
    }

    /// The number of clients, which is kept up to date.
    pub(super) fn client_count(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.client_count)
    }

    /// Logs a line; never waits.
    pub(super) fn tell(&self, line: &str) {
        self.notes.push(line.to_owned());
    }

    /// Makes an opened board the one that is served.
    pub(super) fn attach(&self, link: Arc<dyn Link>) -> Arc<Board> {
        let board = self.opened(link, None);
        self.state.lock().board = Ok(Arc::clone(&board));
        board
    }

    /// Makes the board `lost`, which was opened again, the one that is served. If axes have to be stopped the server is the
    /// writer from now on, until [`end_standstill`](Self::end_standstill), and these axes are returned.
    pub(super) fn attach_again(&self, link: Arc<dyn Link>, lost: &Board) -> (Arc<Board>, Option<LeftMoving>) {
        let board = self.opened(link, Some(lost));
        // After a reset all axes are disabled, so none has to be stopped. But the reset may have been lost or refused,
        // so the state in the first report decides.
        let is_reset = lost.is_being_reset() && board.first_state().is_some_and(|state| state != MasterState::Op);
        let mut state = self.state.lock();
        let left = state.left_moving.take().filter(|_| !is_reset);
        if let Some(left) = &left {
            state.begin_standstill(&format!("after {}", left.who));
        }
        state.board = Ok(Arc::clone(&board));
        (board, left)
    }

    fn opened(&self, link: Arc<dyn Link>, lost: Option<&Board>) -> Arc<Board> {
        let board = Arc::new(Board::new(link, |link| self.limited(link), lost));
        if board.size().is_none() {
            self.tell(
                "no report has shown yet how wide the board's slots are: until then the axes of a writer that vanishes cannot be \
                 stopped; if the board fills in no CRC, give slot=12 or slot=16 in its link",
            );
        }
        board
    }

    /// The link with the limits of the server's machine file around it.
    fn limited(&self, link: Arc<dyn Link>) -> Arc<dyn Link> {
        let Some(file) = &self.options.machine else { return link };
        let notes = self.notes.clone();
        limits::around_served(link, file, Box::new(move |line| notes.push(line)))
    }

    /// Handles the loss of the board: makes the thread of each client send a Bye and end the connection.
    pub(super) fn lose(&self, board: &Arc<Board>, error: &LinkError) {
        let reason = match error {
            LinkError::Lost { reason, .. } => reason.to_string(),
            other => other.to_string(),
        };
        let mut state = self.state.lock();
        if !is_present(&state.board, board) {
            return;
        }
        for client in &state.clients {
            client.dismiss(End::Lost, &reason);
        }
        let line = format!("the board is gone: {reason}");
        state.board = Err(reason);
        drop(state);
        self.changed.notify_all();
        self.tell(&line);
    }

    /// Whether no client is connected, and the server stops no axes.
    pub(super) fn is_quiet(&self) -> bool {
        let state = self.state.lock();
        state.clients.is_empty() && state.server_reports.is_none()
    }

    /// Whether this board is still the one that is served.
    pub(super) fn has(&self, board: &Arc<Board>) -> bool {
        is_present(&self.state.lock().board, board)
    }

    /// Makes a connection a client and sends the Welcome, or returns the reason of a refusal.
    pub(super) fn join(&self, joining: &mut Joining<'_>) -> Result<Joined, (Refusal, String)> {
        let mut state = self.state.lock();
        let board = match &state.board {
            _ if state.is_stopping => return Err((Refusal::NoBoard, "it is being stopped".to_owned())),
            Err(reason) => return Err((Refusal::NoBoard, reason.clone())),
            Ok(board) => Arc::clone(board),
        };
        // While there is no writer, readers cannot take the last free place: it is kept for a writer. Clients that ask
        // for a stop are counted separately, so that other clients cannot keep them out.
        let kept = joining.role == Role::Reader && state.writer.is_none() && self.options.max_clients > 1;
        let has_room = match joining.role {
            Role::Stopper => state.count(Role::Stopper) < STOPPERS_MAX || state.make_room(Role::Stopper),
            Role::Asker => state.count(Role::Asker) < ASKERS_MAX || state.make_room(Role::Asker),
            Role::Writer | Role::Reader => {
                let others = |client: &&Arc<Client>| matches!(client.role, Role::Writer | Role::Reader);
                state.clients.iter().filter(others).count() + usize::from(kept) < self.options.max_clients
            }
        };
        if !has_room {
            return Err((Refusal::Full, String::new()));
        }
        if let (Role::Writer, Some(who)) = (joining.role, &state.writer) {
            let who = who.clone();
            return Err((Refusal::HasWriter, who));
        }
        if joining.role == Role::Writer && state.stops > 0 {
            return Err((Refusal::HasWriter, "the server itself, which carries out a stop".to_owned()));
        }
        let Joining { role, keepalive, proof, .. } = *joining;
        let (who, channel) = (std::mem::take(&mut joining.who), joining.channel.take());
        if role == Role::Writer {
            state.writer = Some(who.clone());
            state.left_moving = None;
        }
        let client = Arc::new(Client::new(who, role, keepalive, channel, board.dropped()));
        let network = board.network(&self.options.network);
        let (slot, sequence) = board.size_and_sequence();
        client.reply(&Message::Welcome(Welcome {
            proof,
            slot,
            virtual_time: board.info.virtual_time,
            now: board.known_now(),
            sequence,
            board: &board.info.name,
            slaves: &network.slaves,
            counts_per_unit: &network.counts_per_unit,
        }));
        state.clients.push(Arc::clone(&client));
        self.client_count.store(state.clients.len(), Ordering::Relaxed);
        Ok((client, board))
    }

    /// Removes a client. `is_trusted`: the client's axes need not be stopped, because it has closed its link, or no
    /// thread could be started to serve it. Otherwise, if the client was the writer, the server itself becomes the
    /// writer until [`end_standstill`](Self::end_standstill), and the queue of reports for the server is returned. In
    /// all other cases the result is `None`.
    pub(super) fn leave(&self, client: &Arc<Client>, is_trusted: bool) -> Option<Arc<ReportQueue>> {
        let mut state = self.state.lock();
        state.clients.retain(|other| !Arc::ptr_eq(other, client));
        self.client_count.store(state.clients.len(), Ordering::Relaxed);
        if client.role != Role::Writer {
            return None;
        }
        state.writer = None;
        if is_trusted {
            return None;
        }
        Some(state.begin_standstill(&format!("after {}", client.name)))
    }

    /// Ends the time in which the server is the writer to bring axes to a standstill: a client can become the writer
    /// again. `ended`: the result of the attempt; `None`: the axes were left as they are, or the board is lost. `left`:
    /// the axes that still have to be stopped.
    pub(super) fn end_standstill(&self, ended: Option<Standstill>, left: Option<LeftMoving>) {
        let mut state = self.state.lock();
        (state.writer, state.server_reports) = (None, None);
        state.left_moving = left;
        if ended.is_some() {
            state.standstills += 1;
            state.newest_standstill = ended;
        }
        drop(state);
        self.changed.notify_all();
    }

    /// Returns the axes that the server could not stop although the board is present, if the next attempt is due. Then
    /// the server is the writer until [`end_standstill`](Self::end_standstill). Also returns `None` while a client is
    /// the writer and has taken over the axes, and while a stop that a client has asked for is carried out.
    pub(super) fn begin_retry(&self) -> Option<LeftMoving> {
        let mut state = self.state.lock();
        let is_due = |left: &mut LeftMoving| {
            left.tries < TRIES_MAX && left.failed_at.is_some_and(|failed| failed.elapsed() >= RETRY_AFTER)
        };
        if state.writer.is_some() || state.stops > 0 || state.is_stopping || state.board.is_err() {
            return None;
        }
        let left = state.left_moving.take_if(is_due)?;
        state.begin_standstill(&format!("after {}", left.who));
        Some(left)
    }

    /// Begins a stop that the client `by` has asked for.
    pub(super) fn begin_stop(self: &Arc<Self>, by: &Arc<Client>) -> StopProgress {
        by.set_stopping(true);
        self.state.lock().stops += 1;
        StopProgress { since: None, writer: String::new(), by: Arc::clone(by), hub: Arc::clone(self) }
    }

    /// The next step of the stop that the client `by` has asked for. A writer is overruled: its own thread stops the
    /// axes, as after a writer that has vanished. If the server stops axes already, this stop waits for the result.
    pub(super) fn step_stop(&self, by: &str, off: bool, progress: &mut StopProgress) -> StopStep {
        let mut state = self.state.lock();
        if let Some(ended) = &state.newest_standstill
            && progress.since.is_some_and(|since| state.standstills > since)
            && (ended.off || !off)
        {
            return StopStep::Done(ended.clone());
        }
        progress.since.get_or_insert(state.standstills);
        if state.server_reports.is_some() {
            return StopStep::Wait;
        }
        if let Some(writer) = state.clients.iter().find(|client| client.role == Role::Writer) {
            progress.writer.clone_from(&writer.name);
            writer.overrule(by, off);
            return StopStep::Wait;
        }
        progress.since = Some(state.standstills);
        StopStep::Brake(state.begin_standstill(&format!("for {by}")))
    }

    /// Sends a report to all clients, except to a writer on virtual time, which gets it as the answer to its request.
    pub(super) fn publish(&self, board: &Board, frame: &Frame, meta: ReadMeta) {
        board.find_troubles(frame, meta.at, &mut |line| self.notes.push(line));
        let state = self.state.lock();
        // The sequence number is noted under the same lock as the report is sent, so that the Welcome of a new client
        // gives the number of the client's first report.
        board.note_report(frame, meta);
        for client in &state.clients {
            if client.role == Role::Reader || client.role == Role::Writer && !board.info.virtual_time {
                client.report(frame, meta);
            }
        }
        if let Some(queue) = state.server_reports.as_ref().filter(|_| !board.info.virtual_time) {
            queue.push(frame, meta);
        }
    }

    /// Accepts no more clients, and makes the thread of each connected client send a Bye and end the connection.
    pub(super) fn stop(&self) {
        let mut state = self.state.lock();
        state.is_stopping = true;
        let left = if self.options.on_vanish == OnVanish::Leave { "leaves axes as they are" } else { "" };
        for client in &state.clients {
            client.dismiss(End::Stopped, left);
        }
    }

    pub(super) fn is_stopping(&self) -> bool {
        self.state.lock().is_stopping
    }

    /// Called when no thread needs the board any more: marks the server as ended, and ends the waits on the hub and on
    /// the board.
    pub(super) fn end(&self) {
        let board = {
            let mut state = self.state.lock();
            state.is_over = true;
            state.board.clone()
        };
        self.changed.notify_all();
        if let Ok(board) = board {
            board.link.cancel(crate::link::Dir::Read);
        }
    }

    pub(super) fn is_over(&self) -> bool {
        self.state.lock().is_over
    }

    /// Waits for at most `limit`. The wait also ends when the board is lost or the server ends.
    pub(super) fn wait(&self, limit: Duration) {
        let mut state = self.state.lock();
        if !state.is_over {
            self.changed.wait_for(&mut state, limit);
        }
    }
}

fn is_present(state: &Result<Arc<Board>, String>, board: &Arc<Board>) -> bool {
    state.as_ref().is_ok_and(|here| Arc::ptr_eq(here, board))
}
