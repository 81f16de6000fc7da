//! A chip ECM-XF for hosts that are not ours: any [`ChipLink`], served over a Unix socket or TCP as a stream of
//! full-duplex exchanges. A C driver for the chip then runs on the model, with a shim of a few lines in the place of SPI.
//!
//! One thread has the chip and all connections. One host at a time has the chip, as with a chip select; another one is
//! told so and sent away. The server does not look into the bytes that pass.
//!
//! A host that ends its connection without the message that says so has vanished: the server then finds its way into
//! the chip's packets itself and takes the network out of OP ([`OnVanish`]).
//!
//! Files, in the order in which to read them:
//!
//! - `mod.rs`: [`Server`], its options and errors
//! - `wire.rs`: the messages on a connection
//! - `address.rs`: where to listen, and connections of either kind
//! - `service.rs`: the thread
//! - `connection.rs`: a host's connection, which never waits
//! - `vanish.rs`: how axes are stopped when the host has vanished

mod address;
mod connection;
mod service;
mod vanish;
pub mod wire;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

pub use address::{DEFAULT_PORT, Listen, ListenError};

use super::serving::{Serving, Shared};
use crate::link::chip_link::{ChipError, ChipInfo, ChipLink};
use crate::notes::{NoteThread, Notes};
use crate::xf::host::HostConfig;
use address::Listener;
use service::Service;

/// How long a host may take for its first request and for the rest of a message, or to read an answer. \[OURS]
const MESSAGE_TIME_MAX: Duration = Duration::from_secs(2);

/// What happens when the host is gone without having said that it ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnVanish {
    /// The FIFO is switched off and emptied and slaves in OP are brought to SafeOP: drives brake on their own quick-stop
    /// ramp and are off, outputs of IO slaves are off.
    #[default]
    SafeOp,
    /// Nothing is sent: the chip sends what is in its FIFO and then repeats the last outputs for ever, as a chip does
    /// whose host has lost its power.
    Leave,
}

/// A chip's link and how the driver uses it, as [`chip::open`](crate::open::chip::open) gives them.
pub type Opened = (Box<dyn ChipLink>, HostConfig);

/// How a chip is served. All defaults are \[OURS].
#[derive(Clone)]
pub struct Options {
    /// Where to listen; port [`DEFAULT_PORT`] of the loopback address by default.
    pub listen: Listen,
    /// Whether it may listen on an address that other machines can reach. Nobody is asked for a password, so whoever
    /// reaches it moves the axes.
    pub insecure_anyone: bool,
    /// What happens when the host has vanished.
    pub on_vanish: OnVanish,
    /// How long a host may take for its first request and for the rest of a message, or to read an answer; 2 s by default.
    pub message_limit: Duration,
    /// Called with each line of the log, in a thread of its own for which no other thread waits. Lines that it does not
    /// take in time are dropped, and their number is reported to it.
    pub tell: Arc<dyn Fn(&str) + Send + Sync>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            listen: Listen::Tcp(SocketAddr::from(([127, 0, 0, 1], DEFAULT_PORT))),
            insecure_anyone: false,
            on_vanish: OnVanish::default(),
            message_limit: MESSAGE_TIME_MAX,
            tell: Arc::new(|line| log::info!("{line}")),
        }
    }
}

/// Why a chip cannot be served.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ServeError {
    /// Other machines could connect, and nobody is asked who they are.
    #[error(
        "{listen} can be reached from other machines, and a served chip knows no password and no encryption: whoever reaches it \
         moves the axes; listen on 127.0.0.1 and lead the port through a tunnel, `ssh -N -L {}:127.0.0.1:{} HOST` on the other \
         machine (docs/XF-PORT.md), or say --insecure-anyone if everybody there may do that",
        listen.port(), listen.port()
    )]
    NeedsTunnel { listen: SocketAddr },
    /// The server cannot listen there.
    #[error("cannot listen on {listen}: {message}; {next}")]
    Listen { listen: Listen, message: String, next: &'static str },
    /// The chip cannot be reached.
    #[error(transparent)]
    Chip(#[from] ChipError),
    /// The system did not provide a thread or another resource.
    #[error("{what}: {source}; free some memory, files or threads, then start it again")]
    System { what: &'static str, source: io::Error },
}

/// A chip that is served until this value is stopped or dropped.
pub struct Server {
    listen: Listen,
    info: ChipInfo,
    serving: Serving,
}

impl Server {
    /// Opens the chip and listens. `open` is called again when a host comes after the link has failed.
    ///
    /// # Errors
    /// [`ServeError`].
    pub fn start(
        mut open: impl FnMut() -> Result<Opened, ChipError> + Send + 'static,
        options: Options,
    ) -> Result<Self, ServeError> {
        if let Listen::Tcp(listen) = options.listen
            && !listen.ip().is_loopback()
            && !options.insecure_anyone
        {
            return Err(ServeError::NeedsTunnel { listen });
        }
        let listener = Listener::bind(&options.listen)?;
        let system = |what| move |source| ServeError::System { what, source };
        let listen = listener.place().map_err(system("ask where it listens"))?;
        let opened = open()?;
        let info = opened.0.info();
        let shared = Shared::new().map_err(system("make a socket"))?;
        let notes = Notes::<String>::default();
        let teller = NoteThread::of_lines(&notes, Arc::clone(&options.tell));
        let teller = teller.map_err(system("start the thread of the log"))?;
        let service = Service::new(opened, Box::new(open), listener, Arc::clone(&shared), options, notes);
        let serving = Serving::start("ecmsk-xf", shared, teller, move || service.run());
        Ok(Self { listen, info, serving: serving.map_err(system("start the thread of the chip"))? })
    }

    /// Where it listens, with the port that the system has chosen.
    pub const fn listen(&self) -> &Listen {
        &self.listen
    }

    /// The chip's link, as it was when it was opened first.
    pub const fn info(&self) -> &ChipInfo {
        &self.info
    }

    /// Waits until [`Options::tell`] has been called for all lines so far, at most 1 s.
    pub fn flush(&self) {
        self.serving.flush();
    }

    /// Ends the server. If a host has the chip this is, for its axes, as if it had vanished ([`OnVanish`]).
    pub fn stop(self) {
        drop(self.serving);
    }
}
