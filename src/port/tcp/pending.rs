//! A connection from its greeting until its first message, the Hello. It has no thread of its own: the listening thread
//! handles all pending connections, and none of the functions here waits.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use rustix::event::PollFd;
use rustls::Connection;

use super::ServeOptions;
use super::session::Introduction;
use crate::span::Span;
use crate::tcp::wire::{Greeting, Message, Refusal};
use crate::tcp::{Came, Channel, Inbox, Material, Out, PROOF_LEN, Secret, ServerTls, Side};

/// How long a refused connection may take to receive the reason of the refusal. \[OURS]
const FAREWELL_MAX: Duration = Duration::from_millis(500);

/// A connection that is not yet a client.
pub(super) struct PendingConnection {
    pub(super) from: SocketAddr,
    /// When the server accepted the connection.
    pub(super) came: Instant,
    /// Whether the client has sent any bytes.
    pub(super) has_sent: bool,
    channel: Channel,
    inbox: Inbox,
    out: Out,
    /// The TLS session until its handshake is complete. `None`: the server uses no TLS, or the handshake is complete.
    handshake: Option<Box<Connection>>,
    material: Option<Material>,
    /// The secret that the client has to know: the server's secret when the connection came. `None`: no secret is
    /// needed.
    secret: Option<Secret>,
    /// For a refused connection: how long it may still take to receive the reason. `None`: the connection was not
    /// refused.
    refused_until: Option<Instant>,
}

/// The result of handling a pending connection.
pub(super) enum Look {
    /// The Hello, the connection's first message, has not arrived yet: look again when bytes arrive, or at the
    /// deadline.
    Waits,
    /// The connection's first message, the Hello, has arrived and is valid.
    Introduced(Introduction),
    /// The connection has to be refused with [`PendingConnection::refuse`].
    Refused(Refusal, String),
    /// The connection has ended, with the reason; `None` after a refusal.
    Ended(Option<String>),
}

impl PendingConnection {
    /// Sends the greeting to a new connection. With `secured` it prepares the TLS handshake, and the client has to know
    /// that secret.
    ///
    /// # Errors
    /// The socket cannot be set up, the greeting cannot be sent, or the TLS session cannot be made.
    pub(super) fn greet(
        socket: TcpStream,
        from: SocketAddr,
        now: Instant,
        secured: Option<(&ServerTls, Secret)>,
    ) -> io::Result<Box<Self>> {
        let channel = Channel::without_waker(socket)?;
        let mut out = Out::default();
        channel.stage_plain(&Greeting { tls: secured.is_some(), has_room: true }.encode(), &mut out);
        // No wait is needed, since the send buffer of a new connection has room for the greeting.
        channel.push(&mut out)?;
        let (tls, secret) = secured.unzip();
        let handshake = tls.map(ServerTls::accept).transpose()?.map(Box::new);
        let (inbox, material) = (Inbox::default(), None);
        let has_sent = false;
        let (came, refused_until) = (now, None);
        Ok(Box::new(Self { from, came, has_sent, channel, inbox, out, handshake, material, secret, refused_until }))
    }

    /// Makes a connection pending again after a valid Hello that the hub has refused (no board, no free place, or a
    /// second writer): it is kept until the client has received the reason.
    pub(super) fn from_client(channel: Channel, inbox: Inbox, from: SocketAddr, came: Instant) -> Box<Self> {
        let (has_sent, out, handshake, material, refused_until) = (true, Out::default(), None, None, None);
        let secret = None;
        Box::new(Self { from, came, has_sent, channel, inbox, out, handshake, material, secret, refused_until })
    }

    /// The connection, and the bytes that have arrived after the Hello.
    pub(super) fn into_parts(self: Box<Self>) -> (Channel, Inbox) {
        (self.channel, self.inbox)
    }

    /// The events on this connection to poll for.
    pub(super) fn waits_for(&self) -> PollFd<'_> {
        self.channel.waits_for(!self.out.is_empty())
    }

    /// Whether the connection was refused and is being closed.
    pub(super) const fn is_refused(&self) -> bool {
        self.refused_until.is_some()
    }

    /// When the connection is closed if its Hello does not arrive or its refusal is not received.
    pub(super) fn deadline(&self, options: &ServeOptions) -> Instant {
        self.refused_until.unwrap_or(self.came + options.hello_limit)
    }

    /// Handles the bytes that have arrived on this connection, and its time limit.
    pub(super) fn look(&mut self, now: Instant, options: &ServeOptions) -> Look {
        if self.is_refused() {
            return self.drain(now);
        }
        match self.receive() {
            Ok(Look::Waits) if now >= self.deadline(options) => {
                Look::Ended(Some(format!("it said nothing for {}", Span(options.hello_limit))))
            }
            Ok(look) => look,
            Err(error) if matches!(error.kind(), ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset) => {
                Look::Ended(Some("it went before it said what it wants".to_owned()))
            }
            Err(error) => Look::Ended(Some(error.to_string())),
        }
    }

    fn receive(&mut self) -> io::Result<Look> {
        if let Some(mut session) = self.handshake.take() {
            if !self.channel.shake_hands(&mut session, &mut self.out)? {
                self.handshake = Some(session);
                return Ok(Look::Waits);
            }
            self.material = Some(self.channel.secured(*session)?);
        }
        loop {
            match self.inbox.next() {
                Ok(Some(message)) => {
                    let hello = Introduction::of(&message);
                    return Ok(hello.map_or_else(|(why, text)| Look::Refused(why, text), |hello| self.check(hello)));
                }
                Ok(None) => {}
                Err(error) => return Ok(Look::Refused(Refusal::NoHello, error.to_string())),
            }
            match self.channel.receive(&mut self.inbox)? {
                Came::Bytes | Came::All => {}
                Came::Nothing => return Ok(Look::Waits),
                Came::End => return Err(ErrorKind::UnexpectedEof.into()),
            }
        }
    }

    /// Checks the client's proof that it knows the secret, if the server has one. A wrong proof is refused.
    fn check(&self, hello: Introduction) -> Look {
        let key = self.secret.as_ref().zip(self.material.as_ref());
        let known = key.is_none_or(|(secret, material)| secret.is_proof(Side::Client, material, &hello.proof));
        if known { Look::Introduced(hello) } else { Look::Refused(Refusal::WrongSecret, String::new()) }
    }

    /// The proof for the Welcome that this server knows the secret, calculated from the secret and the key material of
    /// the TLS session; zeros without a secret.
    pub(super) fn proof(&self) -> [u8; PROOF_LEN] {
        let key = self.secret.as_ref().zip(self.material.as_ref());
        key.map_or([0; PROOF_LEN], |(secret, material)| secret.prove(Side::Server, material))
    }

    /// Begins to send the reason of a refusal.
    pub(super) fn refuse(&mut self, why: Refusal, text: &str, now: Instant) {
        // If this fails, the client's connection ends without a reason.
        let _ = self.channel.stage(&Message::Refused { why, text }, &mut self.out);
        let _ = self.channel.push(&mut self.out);
        self.refused_until = Some(now + FAREWELL_MAX);
        self.end_sending();
    }

    fn end_sending(&self) {
        if self.out.is_empty() {
            self.channel.end(false);
        }
    }

    /// Discards received bytes until the other end has closed, because closing a connection with unread bytes would
    /// also discard what was sent.
    fn drain(&mut self, now: Instant) -> Look {
        let was_empty = self.out.is_empty();
        if self.channel.push(&mut self.out).is_err() || now >= self.refused_until.unwrap_or(now) {
            return Look::Ended(None);
        }
        if !was_empty {
            self.end_sending();
        }
        loop {
            self.inbox.clear();
            match self.channel.receive(&mut self.inbox) {
                Ok(Came::Bytes | Came::All) => {}
                Ok(Came::Nothing) => return Look::Waits,
                Ok(Came::End) | Err(_) => return Look::Ended(None),
            }
        }
    }
}
