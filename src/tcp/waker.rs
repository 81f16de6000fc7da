//! Ends a wait on a socket from another thread: a second socket that the wait polls as well.

use std::io::{self, Read as _, Write as _};

#[cfg(windows)]
use pair::Pair;
#[cfg(unix)]
use std::os::unix::net::UnixStream as Pair;

/// Ends a wait of another thread. It has two connected sockets: a wait polls `woken`, and a byte that is written to
/// `wakes` ends the wait.
pub struct Waker {
    wakes: Pair,
    woken: Pair,
}

impl Waker {
    /// A waker that has not been used yet.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn new() -> io::Result<Self> {
        let (wakes, woken) = Pair::pair()?;
        wakes.set_nonblocking(true)?;
        woken.set_nonblocking(true)?;
        Ok(Self { wakes, woken })
    }

    /// Ends the wait in progress. If no thread waits now, the next wait ends at once.
    pub fn wake(&self) {
        // An error is ignored: if the socket's buffer is full, unread wake-ups end the wait anyway.
        let _ = (&self.wakes).write(&[0]);
    }

    /// The socket that a wait polls for reading, in addition to the socket of the connection.
    pub const fn waited(&self) -> &Pair {
        &self.woken
    }

    /// Discards all wake-ups so far.
    pub fn seen(&self) {
        let mut seen = [0; 64];
        // If a read does not fill the buffer, the socket is empty.
        while matches!((&self.woken).read(&mut seen), Ok(count) if count == seen.len()) {}
    }
}

/// A pair of connected sockets for Windows. Windows has no `socketpair`, and a wait on the connection's socket can include only
/// other sockets.
#[cfg(windows)]
mod pair {
    use std::io::{self, Read, Write};
    use std::net::{Ipv4Addr, UdpSocket};
    use std::os::windows::io::{AsSocket, BorrowedSocket};

    /// A UDP socket on the loopback interface that sends to the other socket of the pair and receives from it only: the system
    /// discards datagrams of other programs.
    pub struct Pair(UdpSocket);

    impl Pair {
        /// Two sockets connected to each other.
        pub fn pair() -> io::Result<(Self, Self)> {
            let any = (Ipv4Addr::LOCALHOST, 0);
            let (one, other) = (UdpSocket::bind(any)?, UdpSocket::bind(any)?);
            one.connect(other.local_addr()?)?;
            other.connect(one.local_addr()?)?;
            Ok((Self(one), Self(other)))
        }

        pub fn set_nonblocking(&self, on: bool) -> io::Result<()> {
            self.0.set_nonblocking(on)
        }
    }

    impl Write for &Pair {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.send(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Read for &Pair {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            // Receives datagrams, which have one byte each, until the caller's buffer is full or no datagram is left.
            let mut count = 0;
            for byte in bytes.iter_mut() {
                match self.0.recv(std::slice::from_mut(byte)) {
                    Ok(_) => count += 1,
                    Err(error) if count == 0 => return Err(error),
                    Err(_) => break,
                }
            }
            Ok(count)
        }
    }

    impl AsSocket for Pair {
        fn as_socket(&self) -> BorrowedSocket<'_> {
            self.0.as_socket()
        }
    }
}
