//! Addresses of a served chip, a TCP port or a Unix socket, and the connections of either kind.

use std::fmt;
use std::io::{self, Read, Write};
use std::net::{IpAddr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::str::FromStr;
use std::time::Duration;

#[cfg(unix)]
use std::os::unix::net::UnixStream;
#[cfg(unix)]
use std::path::PathBuf;

use rustix::event::{PollFd, PollFlags};
use rustix::net::{RecvFlags, sockopt};

use super::ServeError;
#[cfg(unix)]
use crate::local_socket::LocalSocket;
use crate::port::listen::advice;

/// The TCP port on which a chip is served by default. \[OURS]
pub const DEFAULT_PORT: u16 = 4712;

/// TCP keep-alive: the idle time before the first probe, the time between two probes, and the number of unanswered
/// probes that end the connection. A host whose cable is pulled is noticed after 4 s. \[OURS]
const KEEPALIVE_IDLE: Duration = Duration::from_secs(1);
const KEEPALIVE_INTERVAL: Duration = Duration::from_secs(1);
const KEEPALIVE_PROBES: u32 = 3;

/// An address on which to listen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Listen {
    /// A port of an address of this machine; port 0 chooses any free one.
    Tcp(SocketAddr),
    /// A Unix socket at this path, which its owner alone may use.
    #[cfg(unix)]
    Unix(PathBuf),
}

/// A text that is not a valid address to listen on.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ListenError(String);

impl FromStr for Listen {
    type Err = ListenError;

    fn from_str(text: &str) -> Result<Self, ListenError> {
        #[cfg(unix)]
        if let Some(path) = text.strip_prefix("unix:")
            && !path.is_empty()
        {
            return Ok(Self::Unix(path.into()));
        }
        text.parse().map(Self::Tcp).map_err(|_| {
            ListenError(match text.parse::<IpAddr>() {
                Ok(address) => format!("the port is missing: write {}", SocketAddr::new(address, DEFAULT_PORT)),
                Err(_) => format!(
                    "`{text}` is neither ADDR:PORT, e.g. 127.0.0.1:{DEFAULT_PORT}, nor unix:PATH (not on Windows)"
                ),
            })
        })
    }
}

impl fmt::Display for Listen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(address) => address.fmt(f),
            #[cfg(unix)]
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
        }
    }
}

/// The socket on which the server of a chip listens.
pub(super) enum Listener {
    Tcp(TcpListener),
    #[cfg(unix)]
    Unix(LocalSocket),
}

impl Listener {
    pub fn bind(listen: &Listen) -> Result<Self, ServeError> {
        let failed =
            |error: io::Error, next| ServeError::Listen { listen: listen.clone(), message: error.to_string(), next };
        match listen {
            Listen::Tcp(address) => {
                let bound = TcpListener::bind(address).and_then(|listener| {
                    listener.set_nonblocking(true)?;
                    Ok(Self::Tcp(listener))
                });
                bound.map_err(|error| {
                    let next = advice(*address, &error);
                    failed(error, next)
                })
            }
            #[cfg(unix)]
            Listen::Unix(path) => LocalSocket::bind(path).map(Self::Unix).map_err(|error| {
                let next = match error.kind() {
                    io::ErrorKind::AddrInUse => "stop what listens there, or name another path with `--listen`",
                    io::ErrorKind::AlreadyExists => "name a path at which nothing is with `--listen`",
                    _ => "name a path in a folder that this user may write to with `--listen`",
                };
                failed(error, next)
            }),
        }
    }

    /// The address on which the socket listens. Port 0 is replaced by the port that the system has chosen.
    pub fn place(&self) -> io::Result<Listen> {
        match self {
            Self::Tcp(listener) => listener.local_addr().map(Listen::Tcp),
            #[cfg(unix)]
            Self::Unix(place) => Ok(Listen::Unix(place.path().to_owned())),
        }
    }

    pub fn poll_fd(&self) -> PollFd<'_> {
        match self {
            Self::Tcp(listener) => PollFd::new(listener, PollFlags::IN),
            #[cfg(unix)]
            Self::Unix(place) => PollFd::new(place.listener(), PollFlags::IN),
        }
    }

    /// Accepts a waiting connection, and sets it to non-blocking; TCP also sends without delay and with keep-alive.
    /// Returns the connection with the name of its other end; `None`: no connection is waiting.
    pub fn accept(&self) -> io::Result<Option<(Stream, String)>> {
        let accepted = match self {
            Self::Tcp(listener) => listener.accept().and_then(|(stream, from)| {
                stream.set_nonblocking(true)?;
                stream.set_nodelay(true)?;
                sockopt::set_socket_keepalive(&stream, true)?;
                sockopt::set_tcp_keepidle(&stream, KEEPALIVE_IDLE)?;
                sockopt::set_tcp_keepintvl(&stream, KEEPALIVE_INTERVAL)?;
                sockopt::set_tcp_keepcnt(&stream, KEEPALIVE_PROBES)?;
                Ok((Stream::Tcp(stream), from.to_string()))
            }),
            #[cfg(unix)]
            Self::Unix(place) => place.listener().accept().and_then(|(stream, _)| {
                stream.set_nonblocking(true)?;
                let who = process_at(&stream);
                Ok((Stream::Unix(stream), who))
            }),
        };
        match accepted {
            Ok(accepted) => Ok(Some(accepted)),
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

/// The name or process id of the process at the other end of a Unix socket, if the system gives it.
#[cfg(unix)]
fn process_at(stream: &UnixStream) -> String {
    #[cfg(target_os = "linux")]
    if let Ok(peer) = sockopt::socket_peercred(stream) {
        return format!("process {}", peer.pid.as_raw_nonzero());
    }
    let _ = stream;
    "a process of this machine".to_owned()
}

/// A non-blocking connection to a host.
#[derive(Debug)]
pub(super) enum Stream {
    Tcp(TcpStream),
    #[cfg(unix)]
    Unix(UnixStream),
}

impl Stream {
    pub fn poll_fd(&self, events: PollFlags) -> PollFd<'_> {
        match self {
            Self::Tcp(stream) => PollFd::new(stream, events),
            #[cfg(unix)]
            Self::Unix(stream) => PollFd::new(stream, events),
        }
    }

    /// Whether the other end has closed the connection. While received bytes are unread this cannot be known, and the
    /// result is false.
    pub fn has_ended(&self) -> bool {
        let mut byte = [0; 1];
        let peeked = match self {
            Self::Tcp(stream) => rustix::net::recv(stream, &mut byte[..], RecvFlags::PEEK),
            #[cfg(unix)]
            Self::Unix(stream) => rustix::net::recv(stream, &mut byte[..], RecvFlags::PEEK),
        };
        match peeked {
            Ok((count, _)) => count == 0,
            Err(error) => !matches!(error, rustix::io::Errno::WOULDBLOCK | rustix::io::Errno::INTR),
        }
    }

    /// Closes the sending direction: after the bytes sent so far the other end reads the end of the stream.
    pub fn end_output(&self) {
        // An error is ignored: it means that the connection has already ended.
        let _ = match self {
            Self::Tcp(stream) => stream.shutdown(Shutdown::Write),
            #[cfg(unix)]
            Self::Unix(stream) => stream.shutdown(Shutdown::Write),
        };
    }
}

impl Read for Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(buffer),
            #[cfg(unix)]
            Self::Unix(stream) => stream.read(buffer),
        }
    }
}

impl Write for Stream {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.write(buffer),
            #[cfg(unix)]
            Self::Unix(stream) => stream.write(buffer),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
