//! A board on the network: a server for links `tcp://host:port`.
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
//! There are any number of readers up to [`ServeOptions::max_clients`] and one writer. Each client has a thread, which
//! also writes to the board; one more thread reads the board's reports and hands them to every client as far as its
//! socket takes them. What a slow client does not take in time is dropped, the oldest first, and counted; nobody waits
//! for it. On virtual time there is no such thread: the writer's calls let time pass, and readers get what it reads.

mod accept;
#[cfg(all(test, feature = "sim"))]
mod allocation;
mod client;
mod hub;
#[cfg(all(test, feature = "sim"))]
mod middle;
mod pool;
mod repeats;
mod seat;
mod session;
mod stranger;
mod supervise;
#[doc(hidden)]
pub mod unwired;
mod vanish;

use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use crate::link::tcp::Secret;
use crate::link::{KnownNetwork, Link, LinkError, LinkInfo};
use crate::port::notes::{Note, Teller};
use crate::threads;

use accept::Acceptor;
use hub::Hub;
#[doc(hidden)]
pub use session::answer;

pub use crate::link::tcp::DEFAULT_PORT;

/// What happens to moving axes when the writer is gone without having closed its link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnVanish {
    /// They are ramped to a standstill and stay enabled: a vertical axis does not drop. Homing is aborted.
    #[default]
    Ramp,
    /// Nothing: what is in the board's FIFO runs on, a velocity or torque stays.
    Leave,
    /// As [`OnVanish::Ramp`], then they are switched off.
    ServoOff,
}

/// How a board is served. All defaults are \[OURS].
#[derive(Clone)]
pub struct ServeOptions {
    /// Where: by default this machine alone, port [`DEFAULT_PORT`]; port 0: any that is free.
    pub listen: SocketAddr,
    /// What clients have to know; without it only clients of this machine are served.
    pub secret: Option<Secret>,
    /// What happens to moving axes when the writer is gone.
    pub on_vanish: OnVanish,
    /// Clients at the same time: 16, one of which is always a place for a writer.
    pub max_clients: usize,
    /// What clients are told of the network, where it is known better than by the link and the frames that pass.
    pub network: KnownNetwork,
    /// How long a client may take to say what it wants: 2 s.
    pub hello_limit: Duration,
    /// Gets a line for each thing that a person may want to know, in a thread of its own: nothing else waits while it does. What
    /// it does not take in time is dropped, and it is told how many lines those were.
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
            hello_limit: Duration::from_secs(2),
            tell: Arc::new(|line| log::info!("{line}")),
        }
    }
}

/// Why a board is not served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Others than this machine could connect, and no secret is asked for.
    #[error(
        "{listen} can be reached from other machines: give a secret that clients have to know (`--secret-file`), \
         or listen on 127.0.0.1"
    )]
    NeedsSecret {
        /// Where.
        listen: SocketAddr,
    },
    /// The system does not let it listen there.
    #[error("cannot listen on {listen}: {message}; {next}")]
    Listen {
        /// Where.
        listen: SocketAddr,
        /// The system's words.
        message: String,
        /// What to do.
        next: &'static str,
    },
    /// The board cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The system gives something else not.
    #[error("{what}: {message}; free some memory, files or threads, then start it again")]
    System {
        /// What.
        what: &'static str,
        /// Its words.
        message: String,
    },
}

/// A board that is served, until it is stopped or dropped.
pub struct Server {
    hub: Arc<Hub>,
    teller: Teller<String>,
    acceptor: Acceptor,
    supervisor: Option<JoinHandle<()>>,
    address: SocketAddr,
    info: LinkInfo,
}

impl Server {
    /// Opens the board and serves it. `open` is called again whenever the board was lost, until it is back.
    ///
    /// # Errors
    /// [`ServeError`].
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
        let tell = Arc::clone(&hub.options.tell);
        let teller = Teller::start(&hub.notes, move |note| match note {
            Note::Told(line) => tell(&line),
            Note::Dropped(count) => tell(&format!("{count} lines were dropped, those before were not taken in time")),
        });
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

    /// Where it listens.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// The link that is served, as it was opened first.
    pub const fn info(&self) -> &LinkInfo {
        &self.info
    }

    /// Waits until [`ServeOptions::tell`] has got what there was to tell so far, at most 1 s.
    pub fn flush(&self) {
        self.teller.flush();
    }

    /// Tells every client, brings axes to a standstill if there is a writer ([`OnVanish`]), and gives the board back.
    pub fn stop(mut self) {
        self.end();
    }

    fn end(&mut self) {
        self.hub.stop();
        self.acceptor.stop();
        self.hub.end();
        if let Some(supervisor) = self.supervisor.take() {
            // A panic there was printed there.
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
