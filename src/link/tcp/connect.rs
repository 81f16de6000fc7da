//! How a client comes to its connection: greeting, TLS session, hello.

use std::io::{self, ErrorKind};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::thread;
use std::time::{Duration, Instant};

use super::channel::{Came, Channel, Out, first_message};
use super::inbox::Inbox;
use super::options::TcpOptions;
use super::proof::{PROOF_LEN, Secret, Side, how_to_give};
use super::tls;
use super::wire::{GREETING_LEN, Greeting, Hello, Message, Refusal, Welcome, WireError};
use crate::link::{KnownNetwork, LinkError, Stamp};
use crate::sk::SlotSize;
use crate::span::Span;

/// A connection that is through, and what the server says of the board.
pub(super) struct Connected {
    pub(super) channel: Channel,
    pub(super) inbox: Inbox,
    pub(super) out: Out,
    pub(super) slot: Option<SlotSize>,
    pub(super) virtual_time: bool,
    pub(super) now: Stamp,
    pub(super) sequence: u64,
    /// The server's link.
    pub(super) board: String,
    /// What the server knows of the network.
    pub(super) network: KnownNetwork,
}

/// Why there is none, without the link's name.
enum Failed {
    Link(LinkError),
    NoBoard(String),
    InUse(String),
    /// The server has closed the connection after its greeting: it makes room where too many come at once.
    Crowded(String),
}

/// After the server has made room for others. \[OURS]
const AGAIN: Duration = Duration::from_millis(20);

impl From<LinkError> for Failed {
    fn from(error: LinkError) -> Self {
        Self::Link(error)
    }
}

/// Connects to the server of that link, which messages call `name`.
pub(super) fn connect(name: &str, options: &TcpOptions) -> Result<Connected, LinkError> {
    let deadline = Instant::now() + options.connect_limit;
    let connected = loop {
        match try_connect(options, deadline) {
            Err(Failed::Crowded(_)) if Instant::now() + AGAIN < deadline => thread::sleep(AGAIN),
            done => break done,
        }
    };
    connected.map_err(|failed| match failed {
        Failed::Link(error) => error,
        Failed::NoBoard(reason) | Failed::Crowded(reason) => LinkError::NoBoard { name: name.to_owned(), reason },
        Failed::InUse(by) => {
            LinkError::InUse { name: name.to_owned(), by: format!(" by {by}"), instead: "look on with `role=reader`" }
        }
    })
}

fn try_connect(options: &TcpOptions, deadline: Instant) -> Result<Connected, Failed> {
    let secret = Secret::find(options.secret_file.as_deref())?;
    let told = |error: io::Error| Failed::NoBoard(words(&error, options));
    let mut channel = Channel::new(dial(options, deadline).map_err(told)?).map_err(told)?;
    let greeting = greeting(&channel, deadline, options)?;
    let told = |error: io::Error| match error.kind() {
        ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset | ErrorKind::BrokenPipe => {
            Failed::Crowded(words(&error, options))
        }
        _ => told(error),
    };
    if !greeting.has_room {
        let reason = "its server takes no more clients; close one, or give it more (`--max-clients`)";
        return Err(Failed::NoBoard(reason.to_owned()));
    }
    let material = match (&secret, greeting.tls) {
        (None, false) => None,
        (Some(_), true) => {
            let session = tls::connect().map_err(told)?;
            Some(channel.secure(session, deadline).map_err(told)?)
        }
        (None, true) => {
            let reason = "its server wants a secret; give the file it is in with `secret_file=`";
            return Err(Failed::NoBoard(reason.to_owned()));
        }
        // Never advise to leave the secret out: this is what somebody sees who was led to another server than the one that
        // knows it.
        (Some(_), false) => {
            let how = how_to_give(options.secret_file.as_ref());
            return Err(Failed::NoBoard(format!(
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
    channel.stage(&Message::Hello(hello), &mut out).and_then(|()| channel.flush(&mut out, deadline)).map_err(told)?;
    let mut inbox = Inbox::default();
    let answer = first_message(&channel, &mut inbox, deadline, |message| match message {
        Message::Welcome(welcome) => {
            let known = |(secret, material): &(&Secret, _)| secret.is_proof(Side::Server, material, welcome.proof);
            if !key.as_ref().is_none_or(known) {
                let reason = "whoever answers there does not know the secret; somebody may be in between";
                return Err(Failed::NoBoard(reason.to_owned()));
            }
            let network =
                KnownNetwork { slaves: welcome.slaves.to_owned(), counts_per_unit: welcome.counts_per_unit.to_owned() };
            let Welcome { slot, virtual_time, now, sequence, board, .. } = welcome;
            Ok((slot, virtual_time, now, sequence, board.to_owned(), network))
        }
        Message::Refused { why, text } => Err(refused(why, text, options)),
        other => Err(Failed::NoBoard(WireError::OutOfTurn { kind: other.kind() }.to_string())),
    });
    let (slot, virtual_time, now, sequence, board, network) = answer.map_err(told)??;
    Ok(Connected { channel, inbox, out, slot, virtual_time, now, sequence, board, network })
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

fn greeting(channel: &Channel, deadline: Instant, options: &TcpOptions) -> Result<Greeting, Failed> {
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
            // What the server sent before may be lost with it.
            ErrorKind::ConnectionReset => Failed::Crowded(words(&error, options)),
            _ => Failed::NoBoard(words(&error, options)),
        })?;
    }
    Greeting::decode(&bytes).map_err(|error| Failed::NoBoard(error.to_string()))
}

fn refused(why: Refusal, text: &str, options: &TcpOptions) -> Failed {
    Failed::NoBoard(match why {
        Refusal::HasWriter => return Failed::InUse(text.to_owned()),
        Refusal::NoBoard => format!("its server has no board: {text}"),
        Refusal::Full => "its server takes no more clients; close one, or give it more (`--max-clients`)".to_owned(),
        Refusal::WrongSecret => format!(
            "its server has another secret than the one given by {}; give the same to both",
            how_to_give(options.secret_file.as_ref())
        ),
        Refusal::NoHello => format!("its server did not understand: {text}; use the same ecmsk on both"),
    })
}

/// What a user can do about a connection that does not come about.
fn words(error: &io::Error, options: &TcpOptions) -> String {
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

/// What this program is called.
fn program() -> String {
    let path = std::env::current_exe().ok();
    let name = path.as_ref().and_then(|path| path.file_name()).map(|name| name.to_string_lossy().into_owned());
    name.unwrap_or_else(|| "a program".to_owned())
}

/// Waits until the other end has closed, at most until `deadline`; what comes meanwhile is thrown away.
pub(super) fn until_closed(channel: &Channel, inbox: &mut Inbox, deadline: Instant) {
    loop {
        match channel.receive(inbox) {
            Ok(Came::Bytes | Came::All) => while matches!(inbox.next(), Ok(Some(_))) {},
            Ok(Came::Nothing) => {
                if channel.wait_until(false, deadline).is_err() {
                    return;
                }
            }
            Ok(Came::End) | Err(_) => return,
        }
    }
}
