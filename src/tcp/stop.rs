//! A client that makes the server of a board stop all axes, whichever client moves them.

use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use super::channel::Came;
use super::connect::{Connected, broken, closed, connect};
use super::options::TcpOptions;
use super::wire::{End, Message, Role, StopEnd, WireError};
use crate::address::uri::LinkUri;
use crate::link::LinkError;

/// How long the server may take until the axes stand: two stops of up to 2 s each, the FIFO entries before each of
/// them, and the transport. \[OURS]
const STOP_LIMIT: Duration = Duration::from_secs(10);
/// How long the server may take to close the connection after the stop. \[OURS]
const CLOSE_LIMIT: Duration = Duration::from_millis(500);
const REQUEST: u64 = 1;

/// The result of [`stop`]: the axes of the served board were stopped, or could not move because the network is not in
/// OP.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stopped {
    /// The name of the program that was the writer, with its process id and address; `None`: there was no writer.
    pub writer: Option<String>,
    /// Whether the network is in OP. If it is not, no axis follows commands, and none was moved by the network.
    pub in_op: bool,
    /// Further details from the server, for example how many commands it has dropped; may be empty.
    pub text: String,
}

/// Why the axes of a served board were not stopped.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StopError {
    /// The server cannot be reached or does not take the request, or the connection has ended before its answer.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The server does not know the axes, since it has not seen how the network was configured. Moving axes continue to
    /// move. The connection of the writer has ended, so that another program can become the writer and stop the axes.
    #[error(
        "the network was configured before its server came: what moves is not known to it and goes on; use the emergency \
         stop if axes move"
    )]
    Unknown {
        /// The name of the program that was the writer; `None` if no program was.
        writer: Option<String>,
    },
    /// The brake has failed, so that axes may still move.
    #[error("axes may still move: {reason}; use the emergency stop")]
    Failed {
        /// Why the brake has failed.
        reason: String,
    },
}

/// Makes the server of a board bring all axes to a standstill, as after a writer that has vanished, and waits for the
/// result. If a client is the writer, its connection ends, and the calls of its program fail. With `off`, the axes are
/// switched off at standstill. The role in the link is not used, and this client does not count towards the server's
/// limit of clients. Once the server has accepted the request, it carries it out even if this call ends before.
///
/// # Errors
/// [`StopError::Link`] if it is no `tcp:` link, the server cannot be reached, refuses this client or does not answer within
/// 10 s; [`StopError::Unknown`] and [`StopError::Failed`] if axes may still move.
pub fn stop(uri: &LinkUri, off: bool) -> Result<Stopped, StopError> {
    let options = TcpOptions { role: Role::Stopper, ..TcpOptions::from_uri(uri).map_err(LinkError::from)? };
    let name = uri.to_string();
    let deadline = Instant::now() + STOP_LIMIT;
    let mut connected = connect(&name, &options)?;
    let answer = ask(&mut connected, off, &options, deadline).map_err(|error| LinkError::Io {
        what: format!("stop the axes at `{name}`"),
        message: format!("{error}; use the emergency stop if axes move"),
    })?;
    connected.end(CLOSE_LIMIT);
    answer
}

/// The URI with which the server of a `tcp:` link has opened its board, for example `nic:eth1`. This client does not
/// count towards the server's limit of clients, and changes nothing. A URI longer than 256 bytes is cut.
///
/// # Errors
/// [`LinkError`] if it is no `tcp:` link, or the server cannot be reached, has no board or refuses this client.
pub fn served_board(uri: &LinkUri) -> Result<String, LinkError> {
    let options = TcpOptions { role: Role::Stopper, ..TcpOptions::from_uri(uri).map_err(LinkError::from)? };
    let mut connected = connect(&uri.to_string(), &options)?;
    connected.end(CLOSE_LIMIT);
    Ok(connected.board)
}

/// Sends the request, and keep-alive messages until the answer arrives.
fn ask(
    connected: &mut Connected,
    off: bool,
    options: &TcpOptions,
    deadline: Instant,
) -> io::Result<Result<Stopped, StopError>> {
    connected.send(&Message::Stop { request: REQUEST, off }, deadline)?;
    let mut last_sent = Instant::now();
    loop {
        while let Some(message) = connected.inbox.next().map_err(broken)? {
            match message {
                Message::Ping => {}
                Message::Stopped { request: REQUEST, end, writer, text } => return Ok(answered(end, writer, text)),
                Message::Bye { end: End::Stopped, .. } => return Err(io::Error::other("its server was stopped")),
                Message::Bye { text, .. } => return Err(io::Error::other(text.to_owned())),
                other => return Err(broken(WireError::OutOfTurn { kind: other.kind() })),
            }
        }
        match connected.channel.receive(&mut connected.inbox)? {
            Came::Bytes | Came::All => continue,
            Came::End => return Err(closed()),
            Came::Nothing => {}
        }
        let ping = last_sent + options.keepalive / 2;
        if Instant::now() >= ping {
            connected.send(&Message::Ping, deadline)?;
            last_sent = Instant::now();
        } else if Instant::now() >= deadline {
            return Err(io::Error::new(ErrorKind::TimedOut, "its server does not answer"));
        } else {
            connected.channel.wait(false, Some(ping.min(deadline).saturating_duration_since(Instant::now())))?;
        }
    }
}

fn answered(end: StopEnd, writer: &str, text: &str) -> Result<Stopped, StopError> {
    let writer = (!writer.is_empty()).then(|| writer.to_owned());
    match end {
        StopEnd::Stand | StopEnd::NotInOp => {
            Ok(Stopped { writer, in_op: end == StopEnd::Stand, text: text.to_owned() })
        }
        StopEnd::Unknown => Err(StopError::Unknown { writer }),
        StopEnd::Failed => Err(StopError::Failed { reason: text.to_owned() }),
    }
}
