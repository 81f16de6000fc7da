//! A server for links `tcp://host:port`, which shares one board on the network.
//!
//! ```
//! use ecmsk::link::{self, Share, Wait};
//! use ecmsk::port::tcp::{ServeOptions, Server};
//! use ecmsk::sk::Frame;
//!
//! let open = || link::open("sim:?slaves=drive*2&clock=virtual", Share::ByUri);
//! let listen = "127.0.0.1:0".parse()?;
//! let server = Server::start(open, ServeOptions { listen, ..ServeOptions::default() })?;
//!
//! let board = link::open(&format!("tcp://{}", server.address()), Share::ByName)?;
//! let mut report = Frame::new();
//! board.read(&mut report, Wait::Forever)?;
//! board.close();
//! server.stop();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The server accepts one writer, and readers up to [`ServeOptions::max_clients`]. Each client has a thread, which also
//! writes to the board. One more thread reads the board's reports and sends them to every client as far as its socket
//! has room. Reports that a slow client does not take in time are dropped, the oldest first, and counted; no other
//! client waits for it. On virtual time this thread reads no reports: the writer's calls advance the time, and readers
//! get the reports that the writer reads.
//!
//! Files, in the order in which to read them:
//!
//! - `mod.rs`: [`Server`] and its options
//! - `hub.rs`: the state that the threads share: the board, the clients, and which of them is the writer; `board.rs`: the
//!   board
//! - `accept.rs`: the thread that accepts connections, and the thread of a client
//! - `pending.rs`, `pending_pool.rs`: connections that are not yet clients
//! - `client.rs`, `session.rs`: a client's outgoing messages, and the requests that it makes
//! - `supervise.rs`: the thread that reads reports and opens the board again after a loss
//! - `vanish.rs`, `server_link.rs`, `report_queue.rs`: stopping the axes when the writer has vanished, or the board was away,
//!   over a link that the server itself uses
//! - `in_memory.rs`: a server without sockets and threads, for tests; `allocation.rs` and `man_in_the_middle.rs` are tests

mod accept;
#[cfg(all(test, feature = "sim"))]
mod allocation;
mod board;
mod client;
mod hub;
#[doc(hidden)]
pub mod in_memory;
#[cfg(all(test, feature = "sim"))]
mod man_in_the_middle;
mod pending;
mod pending_pool;
mod report_queue;
mod server_link;
mod session;
mod supervise;
mod vanish;

use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::Duration;

use crate::link::{CarriedFile, KnownNetwork, Link, LinkError, LinkInfo};
use crate::notes::NoteThread;
use crate::tcp::Secret;
use crate::threads;

use accept::Acceptor;
use hub::Hub;
#[doc(hidden)]
pub use session::answer;

pub use crate::tcp::DEFAULT_PORT;

/// What the server does with moving axes when the writer has disconnected without closing its link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnVanish {
    /// The axes decelerate to a standstill and stay enabled, so that a vertical axis does not drop. Homing is aborted.
    #[default]
    Ramp,
    /// Nothing is sent: the board executes the rest of its FIFO, and a velocity or torque stays in force.
    Leave,
    /// Like [`OnVanish::Ramp`], and after the standstill the drives are disabled.
    ServoOff,
}

/// The settings of a server. All defaults are \[OURS].
#[derive(Clone)]
pub struct ServeOptions {
    /// The address to listen on. The default is the loopback address with port [`DEFAULT_PORT`]; port 0 chooses any
    /// free port.
    pub listen: SocketAddr,
    /// The secret that clients have to know. Without one, only clients on this machine are allowed.
    pub secret: Option<Secret>,
    /// What the server does with moving axes when the writer has disconnected without closing its link.
    pub on_vanish: OnVanish,
    /// The largest number of clients; 16 by default. One place is reserved for a writer.
    pub max_clients: usize,
    /// The slaves and the counts per unit of their axes that the server tells its clients. An empty field is filled
    /// from passing frames, or else from the board's link.
    pub network: KnownNetwork,
    /// The machine file that the server sends to clients that ask for one ([`machine`](crate::link::tcp::machine)).
    pub machine: Option<Arc<CarriedFile>>,
    /// How long a new connection may take to send its first message, the Hello; 2 s by default.
    pub hello_limit: Duration,
    /// Called with each line of the log, in a thread of its own for which no other thread waits. If the function is too
    /// slow, lines are dropped, and a line reports their number.
    pub tell: Arc<dyn Fn(&str) + Send + Sync>,
}

impl Default for ServeOptions {
    fn default() -> Self {
        Self {
            listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), DEFAULT_PORT),
            secret: None,
            on_vanish: OnVanish::default(),
            max_clients: 16,
            network: KnownNetwork::default(),
            machine: None,
            hello_limit: Duration::from_secs(2),
            tell: Arc::new(|line| log::info!("{line}")),
        }
    }
}

/// Why a board cannot be served.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ServeError {
    /// Other machines could connect, but there is no secret.
    #[error(
        "{listen} can be reached from other machines: give a secret that clients have to know (`--secret-file`), \
         or listen on 127.0.0.1"
    )]
    NeedsSecret { listen: SocketAddr },
    /// The system does not allow the server to listen on this address.
    #[error("cannot listen on {listen}: {message}; {next}")]
    Listen { listen: SocketAddr, message: String, next: &'static str },
    /// The board cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The operating system did not provide a thread or another resource.
    #[error("{what}: {message}; free some memory, files or threads, then start it again")]
    System { what: &'static str, message: String },
}

/// A running server; it ends when this value is stopped or dropped.
pub struct Server {
    hub: Arc<Hub>,
    teller: NoteThread<String>,
    acceptor: Acceptor,
    supervisor: Option<JoinHandle<()>>,
    address: SocketAddr,
    info: LinkInfo,
}

impl Server {
    /// Opens the board and serves it. Whenever the board is lost, `open` is called again until it succeeds.
    ///
    /// # Errors
    /// [`ServeError`]: the address is reachable from other machines and there is no secret, the server cannot listen on
    /// the address, the board cannot be opened, or the system provides no thread.
    pub fn start(
        mut open: impl FnMut() -> Result<Arc<dyn Link>, LinkError> + Send + 'static,
        options: ServeOptions,
    ) -> Result<Self, ServeError> {
        let listen = options.listen;
        if !listen.ip().is_loopback() && options.secret.is_none() {
            return Err(ServeError::NeedsSecret { listen });
        }
        let failed = |error: std::io::Error| ServeError::Listen {
            listen,
            message: error.to_string(),
            next: super::listen::advice(listen, &error),
        };
        let listener = TcpListener::bind(listen).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let link = open()?;
        let info = link.info();
        let system = |what| move |error: std::io::Error| ServeError::System { what, message: error.to_string() };
        let hub = Arc::new(Hub::new(options));
        let teller = NoteThread::of_lines(&hub.notes, Arc::clone(&hub.options.tell));
        let teller = teller.map_err(system("start the thread of the log"))?;
        let supervisor = threads::spawn("ecmsk-serve", {
            let (hub, board) = (Arc::clone(&hub), hub.attach(link));
            move || supervise::run(&hub, board, &mut open)
        });
        let supervisor = supervisor.map_err(system("start the thread of the board"))?;
        match Acceptor::start(listener, &hub) {
            Ok(acceptor) => Ok(Self { hub, teller, acceptor, supervisor: Some(supervisor), address, info }),
            Err(error) => {
                hub.end();
                let _ = supervisor.join();
                Err(system("start to listen")(error))
            }
        }
    }

    /// The address on which the server listens.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// The properties of the served link, as of its first opening.
    pub const fn info(&self) -> &LinkInfo {
        &self.info
    }

    /// Replaces the secret that clients have to know. Connections from now on need the new one; clients that are
    /// connected stay. Returns false, and changes nothing, if the server was started without a secret: then its
    /// clients have connections without encryption.
    pub fn set_secret(&self, secret: Secret) -> bool {
        self.hub.set_secret(secret)
    }

    /// A function that returns the number of clients that are connected now. It takes no lock, and works as long as the
    /// server runs.
    pub fn client_count(&self) -> impl Fn() -> usize + Send + Sync + use<> {
        let count = self.hub.client_count();
        move || count.load(Ordering::Relaxed)
    }

    /// Waits until [`ServeOptions::tell`] was called for all lines so far, at most 1 s.
    pub fn flush(&self) {
        self.teller.flush();
    }

    /// Ends the server: notifies all clients, brings axes to a standstill if there is a writer ([`OnVanish`]), and
    /// closes the board.
    pub fn stop(mut self) {
        self.end();
    }

    fn end(&mut self) {
        self.hub.stop();
        self.acceptor.stop();
        self.hub.end();
        if let Some(supervisor) = self.supervisor.take() {
            // An error is ignored: it means that the thread has panicked, and that was printed when it happened.
            let _ = supervisor.join();
        }
        self.teller.end();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}
