//! One TCP connection, of a client or of a server: a non-blocking socket, with or without TLS. Another thread can end a
//! wait for bytes.

use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use parking_lot::{Mutex, MutexGuard};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustls::Connection;

use super::inbox::Inbox;
use super::proof::Material;
use super::tls;
use super::waker::Waker;
use super::wire::{MESSAGE_MAX, Message};

/// The approximate size of the system's send buffer. It is small, so that old reports for a slow client are dropped and
/// counted by this program instead of waiting in the system. \[OURS]
const SEND_BUFFER_BYTES: usize = 64 * 1024;
/// How long a call waits for the TLS session while another thread encrypts or decrypts with it; then the call fails with
/// [`ErrorKind::TimedOut`]. A program on Windows may end a thread by force while the thread uses the session, which then stays
/// locked for ever. \[OURS]
const SESSION_WAIT_MAX: Duration = Duration::from_secs(1);

/// One end of a TCP connection: its socket, and the TLS session over it if there is one.
pub struct Channel {
    socket: TcpStream,
    tls: Option<Mutex<Connection>>,
    /// Ends the waits of other threads on this connection; `None`: [`Channel::wake`] has no effect.
    waker: Option<Waker>,
}

/// Bytes that are waiting to be sent, and a buffer in which the next message is encoded.
pub struct Out {
    bytes: Vec<u8>,
    sent: usize,
    message: [u8; MESSAGE_MAX],
}

impl Default for Out {
    fn default() -> Self {
        Self { bytes: Vec::with_capacity(4 * MESSAGE_MAX), sent: 0, message: [0; MESSAGE_MAX] }
    }
}

impl Out {
    /// Whether no bytes are waiting: the operating system has accepted all of them for sending.
    pub const fn is_empty(&self) -> bool {
        self.sent == self.bytes.len()
    }

    /// How many bytes are waiting to be sent.
    pub const fn waiting(&self) -> usize {
        self.bytes.len() - self.sent
    }

    /// Appends an unencrypted message to the bytes that wait to be sent. This is for clients in the server's own process. They
    /// have no socket and fetch the bytes with [`take`](Self::take).
    pub fn keep(&mut self, message: &Message<'_>) {
        let length = message.encode(&mut self.message);
        self.bytes.extend_from_slice(&self.message[..length]);
    }

    /// Removes the waiting bytes from the buffer and returns them.
    pub fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }
}

/// Whether a call of [`Channel::receive`] has taken bytes that had arrived, and whether there may be more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Came {
    /// Some bytes were taken, and more may be waiting.
    Bytes,
    /// All bytes that were waiting were taken.
    All,
    /// No bytes were waiting.
    Nothing,
    /// No more bytes will come: the other end has shut down its sending direction, or the connection was reset.
    End,
}

impl Channel {
    /// A connection without TLS.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn new(socket: TcpStream) -> io::Result<Self> {
        let mut channel = Self::without_waker(socket)?;
        channel.make_wakeable()?;
        Ok(channel)
    }

    /// As [`new`](Self::new), for a thread that polls several connections itself instead of calling [`wait`](Self::wait): the
    /// connection has no waker of its own, so [`wake`](Self::wake) has no effect.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn without_waker(socket: TcpStream) -> io::Result<Self> {
        socket.set_nodelay(true)?;
        socket.set_nonblocking(true)?;
        rustix::net::sockopt::set_socket_send_buffer_size(&socket, SEND_BUFFER_BYTES)?;
        Ok(Self { socket, tls: None, waker: None })
    }

    /// Lets [`wake`](Self::wake) end the waits on this connection.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn make_wakeable(&mut self) -> io::Result<()> {
        self.waker = Some(Waker::new()?);
        Ok(())
    }

    /// The events to poll for: until bytes arrive and, with `to_send`, until bytes can be sent.
    pub fn waits_for(&self, to_send: bool) -> PollFd<'_> {
        PollFd::new(&self.socket, if to_send { PollFlags::IN | PollFlags::OUT } else { PollFlags::IN })
    }

    /// Whether the socket has received bytes that no call has read yet.
    pub fn has_unread(&self) -> bool {
        let now = rustix::event::Timespec { tv_sec: 0, tv_nsec: 0 };
        poll(&mut [self.waits_for(false)], Some(&now)).is_ok_and(|ready| ready > 0)
    }

    /// The descriptor of the socket, which children that the program forks have to close.
    #[cfg(unix)]
    pub fn descriptor(&self) -> std::os::fd::RawFd {
        std::os::fd::AsRawFd::as_raw_fd(&self.socket)
    }

    /// Performs the TLS handshake, until `deadline` at most. Returns the keying material of the session, to which the proofs of
    /// the secret are bound.
    ///
    /// # Errors
    /// Errors of the operating system, [`ErrorKind::TimedOut`], and [`ErrorKind::InvalidData`] if the other end does
    /// not use TLS.
    pub fn secure(&mut self, mut session: Connection, deadline: Instant) -> io::Result<Material> {
        let mut out = Out::default();
        while !self.shake_hands(&mut session, &mut out)? {
            self.wait_until(!out.is_empty(), deadline)?;
        }
        self.secured(session)
    }

    /// Continues the handshake of a TLS session as far as possible without waiting; returns whether it is complete.
    ///
    /// # Errors
    /// Those of [`secure`](Self::secure).
    pub fn shake_hands(&self, session: &mut Connection, out: &mut Out) -> io::Result<bool> {
        loop {
            while session.wants_write() {
                session.write_tls(&mut out.bytes)?;
            }
            if !self.push(out)? {
                return Ok(false);
            }
            if !session.is_handshaking() {
                return Ok(true);
            }
            match session.read_tls(&mut &self.socket) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(_) => {
                    if let Err(error) = session.process_new_packets() {
                        // If the handshake has failed, this sends the TLS alert with the reason, in case the other end
                        // still receives.
                        let _ = session.write_tls(&mut &self.socket);
                        return Err(io::Error::new(ErrorKind::InvalidData, error));
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// Encrypts all messages from now on with a TLS session whose handshake is complete. Returns the session's keying material.
    ///
    /// # Errors
    /// Those of [`secure`](Self::secure).
    pub fn secured(&mut self, session: Connection) -> io::Result<Material> {
        let material = tls::material(&session)?;
        self.tls = Some(Mutex::new(session));
        Ok(material)
    }

    /// Whether received bytes may be buffered in the TLS session, where polling the socket does not show them.
    pub const fn keeps_some(&self) -> bool {
        self.tls.is_some()
    }

    /// The address of the other end.
    ///
    /// # Errors
    /// The connection has ended.
    pub fn peer(&self) -> io::Result<SocketAddr> {
        self.socket.peer_addr()
    }

    /// Ends the wait in progress. If no thread waits now, the next wait ends at once.
    pub fn wake(&self) {
        if let Some(waker) = &self.waker {
            waker.wake();
        }
    }

    /// Waits until bytes arrive, with `to_send` also until bytes can be sent, until [`wake`](Self::wake), or until
    /// `limit` has passed (`None`: no limit).
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn wait(&self, to_send: bool, limit: Option<Duration>) -> io::Result<()> {
        let limit = limit.and_then(|limit| Timespec::try_from(limit).ok());
        let socket = self.waits_for(to_send);
        let Some(waker) = &self.waker else { return waited(poll(&mut [socket], limit.as_ref())) };
        let mut ready = [socket, PollFd::new(waker.waited(), PollFlags::IN)];
        waited(poll(&mut ready, limit.as_ref()))?;
        if !ready[1].revents().is_empty() {
            waker.seen();
        }
        Ok(())
    }

    /// As [`wait`](Self::wait), until `deadline` at most. Fails with [`ErrorKind::TimedOut`] if `deadline` has passed before
    /// the call.
    pub(super) fn wait_until(&self, to_send: bool, deadline: Instant) -> io::Result<()> {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        self.wait(to_send, Some(left))
    }

    /// Takes the bytes that have arrived; never waits.
    ///
    /// # Errors
    /// Errors of the operating system, and [`ErrorKind::InvalidData`] if the bytes are not valid TLS.
    pub fn receive(&self, inbox: &mut Inbox) -> io::Result<Came> {
        let room = inbox.room();
        let all = room.len();
        let done = match &self.tls {
            None => (&self.socket).read(room),
            Some(tls) => session(tls).and_then(|mut session| self.decrypt(&mut session, inbox)),
        };
        match done {
            Ok(0) => Ok(Came::End),
            Ok(count) => {
                inbox.came(count);
                // A TLS session may still buffer bytes of the same record, so the caller has to receive again.
                Ok(if self.tls.is_none() && count < all { Came::All } else { Came::Bytes })
            }
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::Interrupted => Ok(Came::Nothing),
                ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset => Ok(Came::End),
                _ => Err(error),
            },
        }
    }

    fn decrypt(&self, tls: &mut Connection, inbox: &mut Inbox) -> io::Result<usize> {
        loop {
            match tls.reader().read(inbox.room()) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                done => return done,
            }
            if tls.read_tls(&mut &self.socket)? == 0 {
                return Ok(0);
            }
            tls.process_new_packets().map_err(|error| io::Error::new(ErrorKind::InvalidData, error))?;
        }
    }

    /// Takes bytes of the greeting, which is not encrypted; never waits.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn receive_plain(&self, bytes: &mut [u8]) -> io::Result<usize> {
        (&self.socket).read(bytes)
    }

    /// Appends bytes that are sent unencrypted, such as the greeting before the TLS handshake, to those that are waiting.
    pub fn stage_plain(&self, bytes: &[u8], out: &mut Out) {
        out.bytes.extend_from_slice(bytes);
    }

    /// Appends a message to the bytes that are waiting to be sent by [`push`](Self::push).
    ///
    /// # Errors
    /// The TLS session has failed.
    pub fn stage(&self, message: &Message<'_>, out: &mut Out) -> io::Result<()> {
        let length = message.encode(&mut out.message);
        if out.is_empty() {
            out.bytes.clear();
            out.sent = 0;
        }
        let Some(tls) = &self.tls else {
            out.bytes.extend_from_slice(&out.message[..length]);
            return Ok(());
        };
        let mut tls = session(tls)?;
        tls.writer().write_all(&out.message[..length])?;
        while tls.wants_write() {
            tls.write_tls(&mut out.bytes)?;
        }
        Ok(())
    }

    /// Sends as many waiting bytes as the system takes without waiting; returns whether these were all.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn push(&self, out: &mut Out) -> io::Result<bool> {
        while !out.is_empty() {
            match (&self.socket).write(&out.bytes[out.sent..]) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => out.sent += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(true)
    }

    /// Sends all waiting bytes until `deadline`.
    ///
    /// # Errors
    /// Errors of the operating system, and [`ErrorKind::TimedOut`].
    pub fn flush(&self, out: &mut Out, deadline: Instant) -> io::Result<()> {
        while !self.push(out)? {
            self.wait_until(true, deadline)?;
        }
        Ok(())
    }

    /// Shuts down sending; with `both`, receiving as well. The other end reads the bytes that were sent, then [`Came::End`].
    pub fn end(&self, both: bool) {
        // An error is ignored: it means that the connection has already ended.
        let _ = self.socket.shutdown(if both { Shutdown::Both } else { Shutdown::Write });
    }
}

fn session(tls: &Mutex<Connection>) -> io::Result<MutexGuard<'_, Connection>> {
    tls.try_lock_for(SESSION_WAIT_MAX).ok_or_else(|| ErrorKind::TimedOut.into())
}

/// Turns a wait that a signal has interrupted (EINTR) into a success: the caller sees a wait that ended early.
fn waited(done: rustix::io::Result<usize>) -> io::Result<()> {
    match done {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// Receives one message, until `deadline` at most, and calls `look` with it.
///
/// # Errors
/// Errors of the operating system; [`ErrorKind::TimedOut`] after `deadline`; [`ErrorKind::UnexpectedEof`] if the other end has
/// ended the connection; [`ErrorKind::InvalidData`] for bytes that are no valid message or no valid TLS.
pub fn first_message<T>(
    channel: &Channel,
    inbox: &mut Inbox,
    deadline: Instant,
    look: impl FnOnce(Message<'_>) -> T,
) -> io::Result<T> {
    loop {
        if let Some(message) = inbox.next().map_err(|error| io::Error::new(ErrorKind::InvalidData, error))? {
            return Ok(look(message));
        }
        match channel.receive(inbox)? {
            Came::Bytes | Came::All => {}
            Came::Nothing => channel.wait_until(false, deadline)?,
            Came::End => return Err(ErrorKind::UnexpectedEof.into()),
        }
    }
}
