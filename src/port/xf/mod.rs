//! A served ECM-XF for other host software: any [`ChipLink`], over a Unix socket or TCP, as a stream of full-duplex
//! exchanges. A C driver for the chip can run on the model, with a shim of a few lines in the place of SPI.
//!
//! One thread serves the chip and all connections. One host at a time has the chip, as a chip select selects one
//! device; any other host is refused with the text that the chip is in use. The server does not interpret the bytes
//! that pass.
//!
//! A host that ends its connection without a Close has vanished. The server then finds the packet boundaries and the
//! data size of the chip by itself, and takes the network out of OP ([`OnVanish`]).
//!
//! Files, in the order in which to read them:
//!
//! - `mod.rs`: [`Server`], its options and errors
//! - `wire.rs`: the messages on a connection
//! - `address.rs`: addresses to listen on, and connections of either kind
//! - `service.rs`: the thread
//! - `connection.rs`: a host's connection, which never waits
//! - `vanish.rs`: stopping the axes when the host has vanished

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

/// How long a host may take for its first request, for the rest of a message, or to read an answer. \[OURS]
const MESSAGE_TIME_MAX: Duration = Duration::from_secs(2);

/// What the server does with the network when the host has disconnected without a Close.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnVanish {
    /// The FIFO is switched off and emptied, and slaves in OP are brought to SafeOP: drives brake on their own
    /// quick-stop ramp and are off, outputs of IO slaves are off.
    #[default]
    SafeOp,
    /// Nothing is sent: the chip sends the rest of its FIFO and then repeats the last outputs for ever, like a chip
    /// whose host has lost its power.
    Leave,
}

/// A chip's link and the settings of the driver for it, as [`chip::open`](crate::open::chip::open) returns them.
pub type Opened = (Box<dyn ChipLink>, HostConfig);

/// The settings of a server. All defaults are \[OURS].
#[derive(Clone)]
pub struct Options {
    /// The address to listen on; port [`DEFAULT_PORT`] of the loopback address by default.
    pub listen: Listen,
    /// Whether the server may listen on an address that other machines can reach. It has no password, so anybody who
    /// can reach it can move the axes.
    pub insecure_anyone: bool,
    /// What the server does with the network when the host has disconnected without a Close.
    pub on_vanish: OnVanish,
    /// How long a host may take for its first request, for the rest of a message, or to read an answer; 2 s by default.
    pub message_limit: Duration,
    /// Called with each line of the log, in a thread of its own for which no other thread waits. If the function is too
    /// slow, lines are dropped, and a line reports their number.
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
    /// Other machines could connect, and the server does not authenticate them.
    #[error(
        "{listen} can be reached from other machines, and a served chip knows no password and no encryption: anybody \
         who reaches it can move the axes; listen on 127.0.0.1 and lead the port through a tunnel, `ssh -N -L \
         {}:127.0.0.1:{} HOST` on the other machine (docs/XF-PORT.md), or add --insecure-anyone if everybody there may \
         do that",
        listen.port(), listen.port()
    )]
    NeedsTunnel { listen: SocketAddr },
    /// The server cannot listen on the address.
    #[error("cannot listen on {listen}: {message}; {next}")]
    Listen { listen: Listen, message: String, next: &'static str },
    /// The chip cannot be reached.
    #[error(transparent)]
    Chip(#[from] ChipError),
    /// The system did not provide a thread or another resource.
    #[error("{what}: {source}; free some memory, files or threads, then start it again")]
    System { what: &'static str, source: io::Error },
}

/// A running server; it ends when this value is stopped or dropped.
pub struct Server {
    listen: Listen,
    info: ChipInfo,
    serving: Serving,
}

impl Server {
    /// Opens the chip and listens. If the link fails later, `open` is called when the next host connects; if it fails
    /// again, that host is refused with the reason.
    ///
    /// # Errors
    /// [`ServeError`]: other machines could reach the address, the server cannot listen on it, the chip cannot be
    /// opened, or the system provides no thread.
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

    /// The address on which the server listens, with the port that the system has chosen.
    pub const fn listen(&self) -> &Listen {
        &self.listen
    }

    /// The properties of the chip's link, as of its first opening.
    pub const fn info(&self) -> &ChipInfo {
        &self.info
    }

    /// Waits until all lines of the log so far were passed to [`Options::tell`], at most 1 s.
    pub fn flush(&self) {
        self.serving.flush();
    }

    /// Ends the server. If a host uses the chip, the axes are treated as if the host had vanished ([`OnVanish`]).
    pub fn stop(self) {
        drop(self.serving);
    }
}
