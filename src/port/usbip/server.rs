//! The server: it listens, lists its devices, and attaches each board to one host at a time.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use parking_lot::Mutex;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::attach::AttachError;
use super::board::{Board, Event, Listener, Opener};
use super::descriptors::{Identity, IdentityError};
use super::keep_attached;
use super::stream::{SEND_TIMEOUT, Stream};
use super::wire::{self, BUS_ID_LEN, DeviceEntry, OP_LEN, Op, PORT, Refusal, WireError};
use crate::link::LinkError;
use crate::notes::{Note, NoteThread, Notes};
use crate::port::listen::advice;
use crate::threads;

/// How long a client may take to send its request. \[OURS]
const REQUEST_TIME_MAX: Duration = Duration::from_secs(5);
/// The largest number of clients that have not attached a board; when there is one more, the oldest is disconnected.
/// \[OURS]
const PENDING_CLIENTS_MAX: usize = 64;
/// The pause between two attempts to open a lost board. \[OURS]
const RETRY_PAUSE: Duration = Duration::from_millis(500);
/// How often the listening thread checks whether the server is being stopped. \[OURS]
const STOP_CHECK_INTERVAL: Duration = Duration::from_millis(100);

/// The settings of a server. By default it listens on the loopback address only.
#[derive(Clone, Debug)]
pub struct Options {
    /// The TCP address to listen on; port 3240 of the loopback address by default.
    pub listen: SocketAddr,
    /// Whether the server may listen on an address that other machines can reach. USB/IP has no password and no
    /// encryption, so anybody who can reach the server can move the axes.
    pub insecure_anyone: bool,
    /// How long a client may take to send its request; 5 s by default.
    pub request_timeout: Duration,
    /// The largest number of clients that have not attached a board; when there is one more, the oldest is
    /// disconnected; 64 by default.
    pub clients: usize,
    /// The pause between two attempts to open a lost board.
    pub retry: Duration,
    /// How long a host that has attached a board may accept no bytes before its connection is closed; 30 s by default.
    pub send_timeout: Duration,
    /// The sysfs folder of the virtual USB host controller of this machine to which the server attaches all boards,
    /// usually [`VHCI`](super::VHCI). `None`: the server attaches no board by itself, and only clients attach them.
    pub attach: Option<PathBuf>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], PORT)),
            insecure_anyone: false,
            request_timeout: REQUEST_TIME_MAX,
            clients: PENDING_CLIENTS_MAX,
            retry: RETRY_PAUSE,
            send_timeout: SEND_TIMEOUT,
            attach: None,
        }
    }
}

/// What the server needs to know of a board.
pub struct BoardSpec {
    /// The identity of the board in its descriptors. Without a serial number it gets its bus id as one.
    pub identity: Identity,
    /// Opens the board's link, at first and after every loss.
    pub opener: Opener,
}

/// Why boards cannot be served.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ServeError {
    /// Other machines could connect, and USB/IP does not authenticate them.
    #[error(
        "{listen} can be reached from other machines, and USB/IP knows no password and no encryption: anybody who \
         reaches it can move the axes; listen on 127.0.0.1 and lead the port through a tunnel, `ssh -N -L \
         {}:127.0.0.1:{} HOST` on the other machine (docs/VIRTUAL-BOARD.md), or add --insecure-anyone if everybody \
         there may do that",
        listen.port(), listen.port()
    )]
    NeedsTunnel { listen: SocketAddr },
    /// The link of a board cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The link of a board has a virtual clock.
    #[error(
        "`{name}` has a virtual clock, which stands still between two calls; a USB device runs by itself: leave out \
         clock=virtual"
    )]
    VirtualTime { name: String },
    /// The identity of a board does not fit into USB descriptors.
    #[error(transparent)]
    Identity(#[from] IdentityError),
    /// There are more boards than a USB bus can have devices.
    #[error("a bus has 127 devices, not {found}; start another server with --listen")]
    TooMany { found: usize },
    /// The server cannot listen on its address.
    #[error("cannot listen on {address}: {source}; {}", advice(*.address, .source))]
    Listen { address: SocketAddr, source: io::Error },
    /// A board cannot be attached to this machine.
    #[error(transparent)]
    Attach(#[from] AttachError),
    /// The server cannot catch the signals that stop it.
    #[error("cannot catch signals: {0}; start it from a shell")]
    Signals(io::Error),
    /// The operating system did not provide a thread.
    #[error("cannot start a thread: {0}; raise this user's limit (ulimit -u)")]
    Thread(io::Error),
}

/// The largest number of devices on a bus (USB 2.0 8.3.2.1).
const DEVICES_ON_BUS_MAX: usize = 127;

/// A running server; it ends with [`Self::stop`] or when this value is dropped.
pub struct Server {
    address: SocketAddr,
    shared: Arc<Shared>,
    threads: Mutex<Vec<JoinHandle<()>>>,
    teller: NoteThread<Event>,
}

pub(super) struct Shared {
    boards: Arc<[Board]>,
    options: Options,
    stopping: AtomicBool,
    /// Clients that have not attached a board, oldest first.
    clients: Mutex<VecDeque<(u64, TcpStream)>>,
    notes: Notes<Event>,
}

impl Server {
    /// Opens the links of the boards and listens. `tell` is called with each event in a thread of its own, for which no
    /// other thread waits. If `tell` is too slow, events are dropped, and an event reports their number
    /// ([`Event::Dropped`]).
    ///
    /// # Errors
    /// [`ServeError`]: a setting is invalid, the server cannot listen on the address, the link of a board cannot be
    /// opened, a board cannot be attached to this machine, or the system provides no thread.
    pub fn start(options: Options, boards: Vec<BoardSpec>, tell: Listener) -> Result<Self, ServeError> {
        if boards.len() > DEVICES_ON_BUS_MAX {
            return Err(ServeError::TooMany { found: boards.len() });
        }
        if !options.listen.ip().is_loopback() && !options.insecure_anyone {
            return Err(ServeError::NeedsTunnel { listen: options.listen });
        }
        let listener = TcpListener::bind(options.listen)
            .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
            .map_err(|source| ServeError::Listen { address: options.listen, source })?;
        let address = listener.local_addr().map_err(|source| ServeError::Listen { address: options.listen, source })?;

        let notes = Notes::default();
        let teller = NoteThread::start(&notes, move |note| match note {
            Note::Item(event) => tell(&event),
            Note::Dropped(count) => tell(&Event::Dropped { count }),
        });
        let teller = teller.map_err(ServeError::Thread)?;
        let mut opened = Vec::new();
        for (index, spec) in boards.into_iter().enumerate() {
            opened.push(open(index as u16, spec, &options, &notes)?);
        }
        let shared = Arc::new(Shared {
            boards: opened.into(),
            options,
            stopping: AtomicBool::new(false),
            clients: Mutex::default(),
            notes,
        });
        let server = Self { address, shared, threads: Mutex::default(), teller };
        for index in 0..server.shared.boards.len() {
            let vhci = server.shared.options.attach.clone();
            let attached =
                vhci.as_deref().map(|vhci| keep_attached::attach(&server.shared.boards, index, vhci)).transpose()?;
            server.spawn("usbip-board", move |shared| {
                keep_attached::keep(&shared.boards, index, shared.options.retry, vhci.as_deref(), attached);
            })?;
        }
        server.spawn("usbip-accept", move |shared| shared.accept(&listener))?;
        Ok(server)
    }

    /// The address on which the server listens, with the port that the system has chosen.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// The bus ids of the boards, in the order in which they were given.
    pub fn bus_ids(&self) -> impl Iterator<Item = &str> {
        self.shared.boards.iter().map(Board::bus_id)
    }

    /// Waits until the listener has been called for all events so far, at most 1 s.
    pub fn flush(&self) {
        self.teller.flush();
    }

    /// Disconnects the hosts, closes the links and ends all threads.
    pub fn stop(&self) {
        self.shared.stopping.store(true, Ordering::Release);
        for board in &*self.shared.boards {
            board.stop();
        }
        for (_, client) in self.shared.clients.lock().drain(..) {
            // An error is ignored: it means that the connection has already ended.
            let _ = client.shutdown(Shutdown::Both);
        }
        // A thread may have started another one before it ended, so the list is read again each time.
        while let Some(thread) = self.threads.lock().pop() {
            let _ = thread.join();
        }
        self.teller.end();
    }

    fn spawn(&self, name: &str, work: impl FnOnce(&Arc<Shared>) + Send + 'static) -> Result<(), ServeError> {
        let shared = self.shared.clone();
        match threads::spawn(name, move || work(&shared)) {
            Ok(thread) => {
                self.threads.lock().push(thread);
                Ok(())
            }
            Err(error) => {
                self.stop();
                Err(ServeError::Thread(error))
            }
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop();
    }
}

fn open(index: u16, spec: BoardSpec, options: &Options, notes: &Notes<Event>) -> Result<Board, ServeError> {
    let BoardSpec { mut identity, opener } = spec;
    let link = opener()?;
    let info = link.info();
    if info.virtual_time {
        return Err(ServeError::VirtualTime { name: info.name });
    }
    if identity.serial.is_empty() {
        identity.serial = super::board::bus_id(index);
    }
    Ok(Board::new(index, identity, link, opener, options.send_timeout, notes.clone())?)
}

impl Shared {
    pub fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Acquire)
    }

    fn accept(self: &Arc<Self>, listener: &TcpListener) {
        // Client threads that are still running are joined here. Each of them soon ends by itself, or it serves a
        // board, and then `stop` disconnects its host.
        let mut threads: Vec<JoinHandle<()>> = Vec::new();
        for number in 0.. {
            let Some((stream, from)) = self.next_client(listener) else { break };
            threads.retain(|thread| !thread.is_finished());
            self.register(number, &stream);
            let shared = self.clone();
            match threads::spawn("usbip-client", move || shared.client(number, stream, from)) {
                Ok(thread) => threads.push(thread),
                Err(error) => {
                    self.forget(number);
                    self.log_rejected(from, &format!("no thread for it: {error}"));
                }
            }
        }
        for thread in threads {
            let _ = thread.join();
        }
    }

    /// Waits for the next connection; `None` when the server stops.
    fn next_client(&self, listener: &TcpListener) -> Option<(TcpStream, SocketAddr)> {
        let pause = Timespec { tv_sec: 0, tv_nsec: STOP_CHECK_INTERVAL.as_nanos() as _ };
        loop {
            if self.is_stopping() {
                return None;
            }
            match listener.accept() {
                Ok((stream, from)) => match stream.set_nonblocking(false) {
                    Ok(()) => return Some((stream, from)),
                    Err(error) => self.log_rejected(from, &error.to_string()),
                },
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    // If the wait is interrupted, the loop accepts and waits again.
                    let _ = poll(&mut [PollFd::new(listener, PollFlags::IN)], Some(&pause));
                }
                // Either no file descriptor was left, or the client has disconnected already. The next attempt may
                // succeed.
                Err(error) => {
                    self.notes.push(Event::SystemError { what: format!("cannot take a client of USB/IP: {error}") });
                    thread::sleep(STOP_CHECK_INTERVAL);
                }
            }
        }
    }

    /// Registers a client's connection, so that the stop of the server can end it. If there are too many, the oldest
    /// connection is ended.
    fn register(&self, number: u64, stream: &TcpStream) {
        let mut clients = self.clients.lock();
        if clients.len() >= self.options.clients
            && let Some((_, oldest)) = clients.pop_front()
        {
            let _ = oldest.shutdown(Shutdown::Both);
        }
        match stream.try_clone() {
            Ok(stream) => clients.push_back((number, stream)),
            // A connection that cannot be registered is not ended by `stop`. The time limit of its request ends it.
            Err(error) => {
                self.notes.push(Event::SystemError { what: format!("cannot watch a client of USB/IP: {error}") });
            }
        }
        // `stop` ends the registered connections. If it has done so just before this one was registered, this one is
        // ended here.
        if self.is_stopping() {
            let _ = stream.shutdown(Shutdown::Both);
        }
    }

    fn forget(&self, number: u64) {
        self.clients.lock().retain(|(other, _)| *other != number);
    }

    fn client(&self, number: u64, stream: TcpStream, from: SocketAddr) {
        let request = self.request(&stream);
        self.forget(number);
        match request {
            Ok(Wanted::Nothing) => {}
            Ok(Wanted::Board(index)) => self.give(index, stream, from),
            Err(error) => self.log_rejected(from, &error.to_string()),
        }
    }

    /// Reads a client's request. Answers it, unless it is a request to attach a board that exists: `give` answers that.
    fn request(&self, mut stream: &TcpStream) -> Result<Wanted, RequestError> {
        let request_timeout = Some(self.options.request_timeout);
        stream.set_read_timeout(request_timeout)?;
        stream.set_write_timeout(request_timeout)?;
        let mut op = [0; OP_LEN];
        // A client that disconnects without a request is no error.
        match stream.read(&mut op[..1])? {
            0 => return Ok(Wanted::Nothing),
            _ => stream.read_exact(&mut op[1..])?,
        }
        let mut answer = Vec::new();
        match Op::parse(&op)? {
            Op::DeviceList => {
                let there: Vec<DeviceEntry<'_>> =
                    self.boards.iter().filter(|board| board.is_there()).map(Board::entry).collect();
                wire::device_list(&mut answer, &there);
            }
            Op::Import => {
                let mut bytes = [0; BUS_ID_LEN];
                stream.read_exact(&mut bytes)?;
                let wanted = wire::bus_id(&bytes)?;
                if let Some(index) = self.boards.iter().position(|board| board.bus_id() == wanted) {
                    return Ok(Wanted::Board(index));
                }
                wire::import(&mut answer, Err(Refusal::NoDevice));
                stream.write_all(&answer)?;
                return Err(RequestError::NoBoard(wanted.to_owned()));
            }
        }
        stream.write_all(&answer)?;
        Ok(Wanted::Nothing)
    }

    fn give(&self, index: usize, stream: TcpStream, from: SocketAddr) {
        let board = &self.boards[index];
        let mut answer = Vec::new();
        let session = match board.take(Stream::Tcp(stream)) {
            Ok(session) => session,
            Err((stream, refusal)) => {
                wire::import(&mut answer, Err(refusal));
                let _ = (&mut &stream).write_all(&answer);
                let why = if refusal == Refusal::Busy { "somebody else has it" } else { "the board is away" };
                return self.log_rejected(from, &format!("{}: {why}", board.bus_id()));
            }
        };
        wire::import(&mut answer, Ok(&board.entry()));
        // If the client has disconnected, sending fails here without an error; the session then finds the closed
        // connection and ends.
        session.greet(&answer);
        board.serve(&session, &from.to_string());
    }

    fn log_rejected(&self, from: SocketAddr, why: &str) {
        self.notes.push(Event::ClientRejected { host: from.to_string(), why: why.to_owned() });
    }
}

/// What a client's request still needs after it was read.
enum Wanted {
    /// The request is answered and needs nothing more.
    Nothing,
    /// The client has requested to attach the board with this index.
    Board(usize),
}

/// Why a client was rejected.
#[derive(Debug, thiserror::Error)]
enum RequestError {
    #[error("{0}")]
    Io(#[from] io::Error),
    #[error(transparent)]
    Wire(#[from] WireError),
    #[error("there is no device `{0}`; `usbip list -r` shows the devices")]
    NoBoard(String),
}
