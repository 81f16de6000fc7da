//! The connection to a host's USB/IP: TCP, or a socket pair whose other end this machine's kernel has.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::Duration;

use super::attach::Socket;

/// How long a host may take nothing of what it is sent, until its connection is given up. \[OURS]
pub const NEVER_READS: Duration = Duration::from_secs(30);

/// When a silent connection is asked whether it lives, how often then, and how many unanswered questions end it: a host
/// that lost its power is noticed after 25 s. \[OURS]
const ASK_AFTER: Duration = Duration::from_secs(10);
const ASK_EVERY: Duration = Duration::from_secs(5);
const ASK_TIMES: u32 = 3;

/// A connection.
#[derive(Debug)]
pub enum Stream {
    /// A client of the server.
    Tcp(TcpStream),
    /// The kernel of this machine.
    Here(Socket),
}

impl Stream {
    /// Prepares a connection for traffic: nothing waits to be sent together, and a host that is gone or never reads is
    /// noticed.
    ///
    /// # Errors
    /// Those of the system.
    pub fn for_traffic(&self, never_reads: Duration) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => {
                stream.set_nodelay(true)?;
                rustix::net::sockopt::set_socket_keepalive(stream, true)?;
                keep_asking(stream)?;
                stream.set_read_timeout(None)?;
                stream.set_write_timeout(Some(never_reads))
            }
            Self::Here(stream) => {
                stream.set_read_timeout(None)?;
                stream.set_write_timeout(Some(never_reads))
            }
        }
    }

    /// Ends both directions: whoever reads or writes is back at once.
    pub fn shutdown(&self) {
        // It fails if the connection has ended already.
        let _ = match self {
            Self::Tcp(stream) => stream.shutdown(Shutdown::Both),
            Self::Here(stream) => stream.shutdown(Shutdown::Both),
        };
    }
}

fn keep_asking(stream: &TcpStream) -> io::Result<()> {
    use rustix::net::sockopt;
    sockopt::set_tcp_keepidle(stream, ASK_AFTER)?;
    sockopt::set_tcp_keepintvl(stream, ASK_EVERY)?;
    sockopt::set_tcp_keepcnt(stream, ASK_TIMES)?;
    Ok(())
}

impl Read for &Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Stream::Tcp(stream) => (&mut &*stream).read(buffer),
            Stream::Here(stream) => (&mut &*stream).read(buffer),
        }
    }
}

impl Write for &Stream {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        match self {
            Stream::Tcp(stream) => (&mut &*stream).write(buffer),
            Stream::Here(stream) => (&mut &*stream).write(buffer),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
