//! What ends a wait on a socket from another thread: something beside it that can be waited for.

use std::io::{self, Read as _, Write as _};

#[cfg(windows)]
use pair::Pair;
#[cfg(unix)]
use std::os::unix::net::UnixStream as Pair;

/// Two connected ends, of which one is written to and the other one waited on.
pub struct Waker {
    wakes: Pair,
    woken: Pair,
}

impl Waker {
    /// Nobody is woken yet.
    ///
    /// # Errors
    /// The system's.
    pub fn new() -> io::Result<Self> {
        let (wakes, woken) = Pair::pair()?;
        wakes.set_nonblocking(true)?;
        woken.set_nonblocking(true)?;
        Ok(Self { wakes, woken })
    }

    /// Ends the wait under way, or the next one.
    pub fn wake(&self) {
        // Full: it will wake up anyhow.
        let _ = (&self.wakes).write(&[0]);
    }

    /// What is to be waited on, beside the socket, until it can be read.
    pub const fn waited(&self) -> &Pair {
        &self.woken
    }

    /// All that woke so far has been seen.
    pub fn seen(&self) {
        let mut seen = [0; 64];
        // It is empty when it says so.
        while matches!((&self.woken).read(&mut seen), Ok(count) if count == seen.len()) {}
    }
}

/// Windows has no pairs of sockets, and can wait for a socket together with nothing but sockets.
#[cfg(windows)]
mod pair {
    use std::io::{self, Read, Write};
    use std::net::{Ipv4Addr, UdpSocket};
    use std::os::windows::io::{AsSocket, BorrowedSocket};

    /// A datagram socket of this machine alone, connected to the other one of the pair: what any other program sends to it
    /// the system throws away.
    pub struct Pair(UdpSocket);

    impl Pair {
        /// Two, connected to each other.
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
            // One datagram after the other, each of one byte: as many as there is room for.
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
