//! A client that asks for the machine file of a server.

use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::{Duration, Instant};

use super::channel::Came;
use super::connect::{Connected, broken, closed, connect};
use super::options::TcpOptions;
use super::wire::{Message, Role, WireError};
use crate::address::uri::LinkUri;
use crate::link::{CarriedFile, LinkError};

/// How long the server may take for the whole file. \[OURS]
const LIMIT: Duration = Duration::from_secs(3);
/// How long the server may take to close the connection afterwards. \[OURS]
const CLOSE_LIMIT: Duration = Duration::from_millis(500);
/// The longest machine file that is taken, bytes. \[OURS]
const FILE_MAX: usize = 1 << 20;

/// Asks the server of a `tcp:` link for its machine file; `None`: the server has none. This client does not count
/// towards the server's limit of clients, and the role in the link is not used.
///
/// # Errors
/// The URI is not a `tcp:` link, the server cannot be reached, it refuses this client (so does an old server without
/// machine files), or it does not answer within 3 s.
pub fn machine(uri: &LinkUri) -> Result<Option<CarriedFile>, LinkError> {
    let options = TcpOptions { role: Role::Asker, ..TcpOptions::from_uri(uri)? };
    let name = uri.to_string();
    let mut connected = connect(&name, &options)?;
    let file = ask(&mut connected).map_err(|error| LinkError::Io {
        what: format!("cannot get the machine file of `{name}`"),
        message: format!("{error}; name a file with --machine, or say --machine none"),
    })?;
    connected.end(CLOSE_LIMIT);
    Ok(file)
}

/// Asks for one part of the file after the other.
fn ask(connected: &mut Connected) -> io::Result<Option<CarriedFile>> {
    let deadline = Instant::now() + LIMIT;
    let (mut bytes, mut name) = (Vec::new(), String::new());
    for request in 1.. {
        let from = u32::try_from(bytes.len()).map_err(|_| too_long())?;
        connected.send(&Message::Ask { request, from }, deadline)?;
        let length = loop {
            let answered = match connected.inbox.next().map_err(broken)? {
                None => None,
                Some(Message::Ping) => continue,
                Some(Message::Machine { request: answered, length, name: found, part }) if answered == request => {
                    bytes.extend_from_slice(part);
                    found.clone_into(&mut name);
                    Some((length as usize, part.is_empty()))
                }
                Some(Message::Bye { text, .. }) => return Err(io::Error::other(text.to_owned())),
                Some(other) => return Err(broken(WireError::OutOfTurn { kind: other.kind() })),
            };
            match answered {
                Some((length, is_empty)) => break if is_empty { bytes.len() } else { length },
                None => receive(connected, deadline)?,
            }
        };
        if bytes.len() > FILE_MAX || length > FILE_MAX {
            return Err(too_long());
        }
        if bytes.len() >= length {
            break;
        }
    }
    let text = String::from_utf8(bytes).map_err(|_| io::Error::from(ErrorKind::InvalidData))?;
    Ok((!text.is_empty()).then(|| CarriedFile::new(Path::new(&name), &text)))
}

fn receive(connected: &mut Connected, deadline: Instant) -> io::Result<()> {
    let Connected { channel, inbox, .. } = connected;
    loop {
        match channel.receive(inbox)? {
            Came::Bytes | Came::All => return Ok(()),
            Came::End => return Err(closed()),
            Came::Nothing if Instant::now() >= deadline => {
                return Err(io::Error::new(ErrorKind::TimedOut, "its server does not answer"));
            }
            Came::Nothing => channel.wait(false, Some(deadline.saturating_duration_since(Instant::now())))?,
        }
    }
}

fn too_long() -> io::Error {
    io::Error::new(ErrorKind::InvalidData, "its server has a machine file of more than 1 MiB")
}
