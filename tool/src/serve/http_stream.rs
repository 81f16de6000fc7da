//! The connection of an HTTP client, with or without TLS.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
#[cfg(feature = "web")]
use std::sync::Arc;
use std::time::Instant;

#[cfg(feature = "web")]
use rustls::{ServerConfig, ServerConnection, StreamOwned};

/// The first byte of a TLS connection: the type of a handshake record (RFC 8446 5.1).
#[cfg(feature = "web")]
const HANDSHAKE: u8 = 0x16;

/// The TLS configuration of a server, with its certificate and key.
#[cfg(feature = "web")]
pub type Tls = Arc<ServerConfig>;
/// Without the feature `web` no server has TLS.
#[cfg(not(feature = "web"))]
#[derive(Clone)]
pub enum Tls {}

/// A connection to a client.
pub struct Stream(Inner);

enum Inner {
    Plain(Timed),
    #[cfg(feature = "web")]
    Tls(Box<StreamOwned<ServerConnection, Timed>>),
}

impl Stream {
    /// A connection whose client has just connected. The TLS handshake is a part of the first read.
    ///
    /// # Errors
    /// The TLS session cannot be made.
    #[cfg_attr(not(feature = "web"), allow(clippy::unnecessary_wraps, reason = "only TLS fails"))]
    pub fn new(socket: TcpStream, tls: Option<&Tls>) -> io::Result<Self> {
        let timed = Timed { socket, until: None, written: 0, is_broken: false };
        Ok(Self(match tls {
            None => Inner::Plain(timed),
            #[cfg(feature = "web")]
            Some(tls) => {
                let session = ServerConnection::new(Arc::clone(tls)).map_err(io::Error::other)?;
                Inner::Tls(Box::new(StreamOwned::new(session, timed)))
            }
            #[cfg(not(feature = "web"))]
            Some(tls) => match *tls {},
        }))
    }

    /// Whether the client speaks no TLS though this server does. Waits for the client's first byte, until the time limit.
    ///
    /// # Errors
    /// The client sends nothing in time.
    pub fn lacks_tls(&self) -> io::Result<bool> {
        match &self.0 {
            Inner::Plain(_) => Ok(false),
            #[cfg(feature = "web")]
            Inner::Tls(tls) => {
                tls.sock.limit(TcpStream::set_read_timeout)?;
                let mut first = [0];
                Ok(tls.sock.socket.peek(&mut first)? == 1 && first != [HANDSHAKE])
            }
        }
    }

    /// The same connection without TLS, before anything was read.
    pub fn without_tls(self) -> Self {
        match self.0 {
            #[cfg(feature = "web")]
            Inner::Tls(tls) => Self(Inner::Plain(tls.sock)),
            plain @ Inner::Plain(_) => Self(plain),
        }
    }

    fn timed(&self) -> &Timed {
        match &self.0 {
            Inner::Plain(timed) => timed,
            #[cfg(feature = "web")]
            Inner::Tls(tls) => &tls.sock,
        }
    }

    /// Whether nothing can be written any more. What the client has sent can still be read.
    pub fn is_broken(&self) -> bool {
        self.timed().is_broken
    }

    /// Sets the time by which all reads and writes have to be done; `None`: the timeouts of the socket count.
    pub fn set_until(&mut self, until: Option<Instant>) {
        match &mut self.0 {
            Inner::Plain(timed) => timed.until = until,
            #[cfg(feature = "web")]
            Inner::Tls(tls) => tls.sock.until = until,
        }
    }

    /// The number of bytes that the system has accepted for sending.
    pub fn written(&self) -> u64 {
        self.timed().written
    }

    /// The socket of the connection.
    pub fn socket(&self) -> &TcpStream {
        &self.timed().socket
    }

    /// Ends the connection after everything was sent.
    ///
    /// # Errors
    /// The client does not receive what was sent.
    pub fn finish(mut self) -> io::Result<()> {
        #[cfg(feature = "web")]
        if let Inner::Tls(tls) = &mut self.0 {
            tls.conn.send_close_notify();
        }
        self.flush()?;
        self.socket().shutdown(Shutdown::Both)
    }
}

impl Read for Stream {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match &mut self.0 {
            Inner::Plain(timed) => timed.read(bytes),
            #[cfg(feature = "web")]
            Inner::Tls(tls) => tls.read(bytes),
        }
    }
}

impl Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.0 {
            Inner::Plain(timed) => timed.write(bytes),
            #[cfg(feature = "web")]
            Inner::Tls(tls) => tls.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.0 {
            Inner::Plain(timed) => timed.flush(),
            #[cfg(feature = "web")]
            Inner::Tls(tls) => tls.flush(),
        }
    }
}

/// A socket whose reads and writes may have to be done by a time. A TLS session reads and writes its socket several times
/// in one call, so that a timeout for each of them would be no limit for the call.
struct Timed {
    socket: TcpStream,
    until: Option<Instant>,
    /// The number of bytes that the system has accepted.
    written: u64,
    /// Whether nothing can be written any more. Writes then fail as if they had no room. A TLS session reads on after
    /// that, and after no other error.
    is_broken: bool,
}

impl Timed {
    fn limit(&self, set: fn(&TcpStream, Option<std::time::Duration>) -> io::Result<()>) -> io::Result<()> {
        let Some(until) = self.until else { return Ok(()) };
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        set(&self.socket, Some(left))
    }
}

impl Read for Timed {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.limit(TcpStream::set_read_timeout)?;
        self.socket.read(bytes).map_err(no_room)
    }
}

impl Write for Timed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.is_broken {
            return Err(ErrorKind::WouldBlock.into());
        }
        self.limit(TcpStream::set_write_timeout)?;
        let written = self.socket.write(bytes).map_err(no_room);
        match &written {
            Ok(count) => self.written += *count as u64,
            Err(error) => self.is_broken = !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
        }
        written
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The error of a timeout of the socket, which Windows calls otherwise.
fn no_room(error: io::Error) -> io::Error {
    if error.kind() == ErrorKind::TimedOut { ErrorKind::WouldBlock.into() } else { error }
}
