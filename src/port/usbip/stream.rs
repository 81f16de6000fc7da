//! The connection to a host that has attached a board: TCP, or a socket pair whose other end belongs to this machine's
//! kernel.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::Duration;

use rustix::net::sockopt;

use super::attach::Socket;

/// How long a host may accept no bytes before its connection is closed. \[OURS]
pub const SEND_TIMEOUT: Duration = Duration::from_secs(30);

/// TCP keep-alive: the idle time before the first probe, the time between two probes, and the number of unanswered
/// probes that end the connection. A host that lost its power is noticed after 10 + 3 * 5 = 25 s. \[OURS]
const KEEPALIVE_IDLE: Duration = Duration::from_secs(10);
const KEEPALIVE_INTERVAL: Duration = Duration::from_secs(5);
const KEEPALIVE_PROBES: u32 = 3;

/// The connection to a host.
#[derive(Debug)]
pub enum Stream {
    /// A client that has connected to the server by TCP.
    Tcp(TcpStream),
    /// This machine's own kernel, through a socket pair.
    Local(Socket),
}

impl Stream {
    /// Prepares the connection for transfers: small messages are sent at once, and a host that is gone or accepts no
    /// bytes is detected.
    ///
    /// # Errors
    /// The system refuses a setting of the socket, for example because the connection has ended already.
    pub fn for_traffic(&self, send_timeout: Duration) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => {
                stream.set_nodelay(true)?;
                sockopt::set_socket_keepalive(stream, true)?;
                sockopt::set_tcp_keepidle(stream, KEEPALIVE_IDLE)?;
                sockopt::set_tcp_keepintvl(stream, KEEPALIVE_INTERVAL)?;
                sockopt::set_tcp_keepcnt(stream, KEEPALIVE_PROBES)?;
                stream.set_read_timeout(None)?;
                stream.set_write_timeout(Some(send_timeout))
            }
            Self::Local(stream) => {
                stream.set_read_timeout(None)?;
                stream.set_write_timeout(Some(send_timeout))
            }
        }
    }

    /// Shuts down both directions, which ends waiting reads and writes at once.
    pub fn shutdown(&self) {
        // An error is ignored: it means that the connection has already ended.
        let _ = match self {
            Self::Tcp(stream) => stream.shutdown(Shutdown::Both),
            Self::Local(stream) => stream.shutdown(Shutdown::Both),
        };
    }
}

impl Read for &Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Stream::Tcp(stream) => (&mut &*stream).read(buffer),
            Stream::Local(stream) => (&mut &*stream).read(buffer),
        }
    }
}

impl Write for &Stream {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        match self {
            Stream::Tcp(stream) => (&mut &*stream).write(buffer),
            Stream::Local(stream) => (&mut &*stream).write(buffer),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
