//! How a client connects: greeting, TLS session, hello, welcome.

use std::io::{self, ErrorKind};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::thread;
use std::time::{Duration, Instant};

use super::channel::{Came, Channel, Out, first_message};
use super::inbox::Inbox;
use super::options::TcpOptions;
use super::proof::{PROOF_LEN, Secret, Side, how_to_give};
use super::tls;
use super::wire::{End, GREETING_LEN, Greeting, Hello, Message, Refusal, Role, Welcome, WireError};
use crate::link::{KnownNetwork, LinkError, Stamp};
use crate::sk::SlotSize;
use crate::span::Span;
#[cfg(unix)]
use crate::threads::LetGo;

/// A connection that the server has accepted, and what its Welcome says about the board.
pub(super) struct Connected {
    #[cfg(unix)]
    pub(super) let_go: LetGo,
    pub(super) channel: Channel,
    pub(super) inbox: Inbox,
    pub(super) out: Out,
    pub(super) slot: Option<SlotSize>,
    pub(super) virtual_time: bool,
    pub(super) now: Stamp,
    pub(super) sequence: u64,
    /// The URI with which the server has opened the board.
    pub(super) board: String,
    /// The slaves and the units of their axes, as the server knows them.
    pub(super) network: KnownNetwork,
}

impl Connected {
    /// Ends the connection after the answer has come: sends a Bye and waits until the server has closed its end, for
    /// `limit` at most. An error is ignored: it means that the connection has already ended.
    pub(super) fn end(&mut self, limit: Duration) {
        let bye = Message::Bye { end: End::Closed, text: "" };
        let until = Instant::now() + limit;
        if self.send(&bye, until).is_ok() {
            self.channel.end(false);
            until_closed(&self.channel, until);
        }
    }

    /// Sends a message; fails if this takes longer than until the time `until`.
    pub(super) fn send(&mut self, message: &Message<'_>, until: Instant) -> io::Result<()> {
        self.channel.stage(message, &mut self.out)?;
        self.channel.flush(&mut self.out, until)
    }
}

/// The error of a server that sends something else than its protocol allows.
pub(super) fn broken(error: WireError) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, format!("its server does not keep to the protocol: {error}"))
}

/// The error of a server that has closed the connection.
pub(super) fn closed() -> io::Error {
    io::Error::new(ErrorKind::UnexpectedEof, "its server has closed the connection")
}

/// Why connecting failed. The name of the link is added later, by `connect`.
enum ConnectError {
    Link(LinkError),
    NoBoard(String),
    InUse(String),
    /// The server has closed the connection after its greeting, to make room for other clients when too many connect at once.
    /// The client tries again.
    Displaced(String),
}

/// The pause before the next attempt after the server has closed the connection to make room for others. \[OURS]
const RETRY_PAUSE: Duration = Duration::from_millis(20);

impl From<LinkError> for ConnectError {
    fn from(error: LinkError) -> Self {
        Self::Link(error)
    }
}

/// Connects to the server; `name` is the name of the link in messages.
pub(super) fn connect(name: &str, options: &TcpOptions) -> Result<Connected, LinkError> {
    let deadline = Instant::now() + options.connect_limit;
    let connected = loop {
        match try_connect(options, deadline) {
            Err(ConnectError::Displaced(_)) if Instant::now() + RETRY_PAUSE < deadline => thread::sleep(RETRY_PAUSE),
            done => break done,
        }
    };
    connected.map_err(|error| match error {
        ConnectError::Link(error) => error,
        ConnectError::NoBoard(reason) | ConnectError::Displaced(reason) => {
            LinkError::NoBoard { name: name.to_owned(), reason }
        }
        ConnectError::InUse(by) => {
            LinkError::InUse { name: name.to_owned(), by: format!(" by {by}"), instead: "look on with `role=reader`" }
        }
    })
}

fn try_connect(options: &TcpOptions, deadline: Instant) -> Result<Connected, ConnectError> {
    let secret = Secret::find(options.secret_file.as_deref())?;
    let failed = |error: io::Error| ConnectError::NoBoard(explain(&error, options));
    let mut channel = Channel::new(dial(options, deadline).map_err(failed)?).map_err(failed)?;
    #[cfg(unix)]
    let let_go = LetGo::of(channel.descriptor());
    let greeting = greeting(&channel, deadline, options)?;
    let failed = |error: io::Error| match error.kind() {
        ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset | ErrorKind::BrokenPipe => {
            ConnectError::Displaced(explain(&error, options))
        }
        _ => failed(error),
    };
    if !greeting.has_room {
        let reason = "its server takes no more clients; close one, or give it more (`--max-clients`)";
        return Err(ConnectError::NoBoard(reason.to_owned()));
    }
    let material = match (&secret, greeting.tls) {
        (None, false) => None,
        (Some(_), true) => {
            let session = tls::connect().map_err(failed)?;
            Some(channel.secure(session, deadline).map_err(failed)?)
        }
        (None, true) => {
            let reason = "its server wants a secret; give the file it is in with `secret_file=`";
            return Err(ConnectError::NoBoard(reason.to_owned()));
        }
        // This error text must never advise to leave the secret out of the link: it also appears when somebody has redirected
        // the client to a server that does not know the secret.
        (Some(_), false) => {
            let how = how_to_give(options.secret_file.as_ref());
            return Err(ConnectError::NoBoard(format!(
                "a secret is given by {how}, and whoever answers there knows none: it may be somebody else in the server's \
                 place, so nothing was said to it; check host and port, and start the right server with --secret-file"
            )));
        }
    };
    let key = secret.as_ref().zip(material);
    let proof = key.as_ref().map_or([0; PROOF_LEN], |(secret, material)| secret.prove(Side::Client, material));
    let mut out = Out::default();
    let program = program();
    let hello = Hello {
        role: options.role,
        keepalive_ms: options.keepalive.as_millis() as u32,
        pid: std::process::id(),
        program: &program,
        proof: &proof,
    };
    channel.stage(&Message::Hello(hello), &mut out).and_then(|()| channel.flush(&mut out, deadline)).map_err(failed)?;
    let mut inbox = Inbox::default();
    let answer = first_message(&channel, &mut inbox, deadline, |message| match message {
        Message::Welcome(welcome) => {
            let known = |(secret, material): &(&Secret, _)| secret.is_proof(Side::Server, material, welcome.proof);
            if !key.as_ref().is_none_or(known) {
                let reason = "whoever answers there does not know the secret; somebody may be in between";
                return Err(ConnectError::NoBoard(reason.to_owned()));
            }
            let network =
                KnownNetwork { slaves: welcome.slaves.to_owned(), counts_per_unit: welcome.counts_per_unit.to_owned() };
            let Welcome { slot, virtual_time, now, sequence, board, .. } = welcome;
            Ok((slot, virtual_time, now, sequence, board.to_owned(), network))
        }
        Message::Refused { why, text } => Err(refused(why, text, options)),
        other => Err(ConnectError::NoBoard(WireError::OutOfTurn { kind: other.kind() }.to_string())),
    });
    let (slot, virtual_time, now, sequence, board, network) = answer.map_err(failed)??;
    Ok(Connected {
        #[cfg(unix)]
        let_go,
        channel,
        inbox,
        out,
        slot,
        virtual_time,
        now,
        sequence,
        board,
        network,
    })
}

fn dial(options: &TcpOptions, deadline: Instant) -> io::Result<TcpStream> {
    let mut last = io::Error::new(ErrorKind::NotFound, "the name has no address");
    for address in (options.host.as_str(), options.port).to_socket_addrs()? {
        let left = deadline.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
        match TcpStream::connect_timeout(&address, left) {
            Ok(socket) => return Ok(socket),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn greeting(channel: &Channel, deadline: Instant, options: &TcpOptions) -> Result<Greeting, ConnectError> {
    let mut bytes = [0; GREETING_LEN];
    let mut filled = 0;
    while filled < bytes.len() {
        let came = match channel.receive_plain(&mut bytes[filled..]) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                filled += count;
                continue;
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => channel.wait_until(false, deadline),
            Err(error) => Err(error),
        };
        came.map_err(|error| match error.kind() {
            // The server may have sent its greeting and then closed the connection to make room for others. A reset can discard
            // the greeting before it is read, so the client tries again after a reset.
            ErrorKind::ConnectionReset => ConnectError::Displaced(explain(&error, options)),
            _ => ConnectError::NoBoard(explain(&error, options)),
        })?;
    }
    Greeting::decode(&bytes).map_err(|error| ConnectError::NoBoard(error.to_string()))
}

fn refused(why: Refusal, text: &str, options: &TcpOptions) -> ConnectError {
    ConnectError::NoBoard(match why {
        Refusal::HasWriter => return ConnectError::InUse(text.to_owned()),
        Refusal::NoBoard => format!("its server has no board: {text}"),
        Refusal::Full if matches!(options.role, Role::Stopper | Role::Asker) => {
            "its server is busy with others that ask for the same; try again".to_owned()
        }
        Refusal::Full => "its server takes no more clients; close one, or give it more (`--max-clients`)".to_owned(),
        Refusal::WrongSecret => format!(
            "its server has another secret than the one given by {}; give the same to both",
            how_to_give(options.secret_file.as_ref())
        ),
        Refusal::NoHello => format!("its server did not understand: {text}; use the same ecmsk on both"),
    })
}

/// The text for an error of a connection attempt: why it has failed, and what the user can do.
fn explain(error: &io::Error, options: &TcpOptions) -> String {
    match error.kind() {
        ErrorKind::ConnectionRefused => {
            format!("nobody listens there; start `ecmsk serve tcp --listen ...:{}` with its board", options.port)
        }
        ErrorKind::TimedOut | ErrorKind::WouldBlock => format!(
            "no answer within {}; check host, port and firewall, or raise `connect_timeout_ms`",
            Span(options.connect_limit)
        ),
        ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset => {
            "its server has closed the connection; see what it says on its standard error".to_owned()
        }
        _ => format!("{error}; check host and port"),
    }
}

/// The name of this program, which the server shows in its log and in refusals of other writers.
fn program() -> String {
    let path = std::env::current_exe().ok();
    let name = path.as_ref().and_then(|path| path.file_name()).map(|name| name.to_string_lossy().into_owned());
    name.unwrap_or_else(|| "a program".to_owned())
}

/// Waits until the other end has closed the connection, at most until `deadline`; received messages are discarded.
pub(super) fn until_closed(channel: &Channel, deadline: Instant) {
    // A separate inbox, since another thread may be using the inbox of the link.
    let mut inbox = Inbox::default();
    loop {
        match channel.receive(&mut inbox) {
            Ok(Came::Bytes | Came::All) => inbox.clear(),
            Ok(Came::Nothing) if channel.wait_until(false, deadline).is_ok() => {}
            Ok(Came::Nothing | Came::End) | Err(_) => return,
        }
    }
}
