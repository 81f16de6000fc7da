//! A connection that has not said yet what it wants. It has no thread: the one that listens looks after all of them, and none of
//! these calls waits.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use rustix::event::PollFd;
use rustls::Connection;

use super::ServeOptions;
use super::session::Introduction;
use crate::link::tcp::wire::{Greeting, Message, Refusal};
use crate::link::tcp::{Came, Channel, Inbox, Material, Out, PROOF_LEN, ServerTls, Side};
use crate::span::Span;

/// What a connection that is told why it ends gets for that. \[OURS]
const FAREWELL: Duration = Duration::from_millis(500);

/// A connection from its greeting to its hello.
pub(super) struct Stranger {
    pub(super) from: SocketAddr,
    /// When it was taken.
    pub(super) came: Instant,
    /// Whether anything came from it.
    pub(super) has_spoken: bool,
    channel: Channel,
    inbox: Inbox,
    out: Out,
    /// The TLS session while it is made.
    handshake: Option<Box<Connection>>,
    material: Option<Material>,
    /// It was told why it ends; until when it may take that.
    leaves_by: Option<Instant>,
}

/// What a look at a stranger found.
pub(super) enum Look {
    /// It is still one.
    Waits,
    /// It has said what it wants.
    Introduced(Introduction),
    /// It is refused, and has to be told so: [`Stranger::refuse`].
    Refused(Refusal, String),
    /// It has ended, and why; without a reason, after a refusal.
    Ended(Option<String>),
}

impl Stranger {
    /// Greets a new connection.
    ///
    /// # Errors
    /// The system's.
    pub(super) fn greet(
        socket: TcpStream,
        from: SocketAddr,
        now: Instant,
        tls: Option<&ServerTls>,
    ) -> io::Result<Box<Self>> {
        let channel = Channel::without_waker(socket)?;
        let mut out = Out::default();
        channel.stage_plain(&Greeting { tls: tls.is_some(), has_room: true }.encode(), &mut out);
        // A new connection takes so few bytes at once.
        channel.push(&mut out)?;
        let handshake = tls.map(ServerTls::accept).transpose()?.map(Box::new);
        let (inbox, material) = (Inbox::default(), None);
        let has_spoken = false;
        Ok(Box::new(Self { from, came: now, has_spoken, channel, inbox, out, handshake, material, leaves_by: None }))
    }

    /// One that has said what it wants, and is not taken.
    pub(super) fn again(channel: Channel, inbox: Inbox, from: SocketAddr, came: Instant) -> Box<Self> {
        let (has_spoken, out, handshake, material, leaves_by) = (true, Out::default(), None, None, None);
        Box::new(Self { from, came, has_spoken, channel, inbox, out, handshake, material, leaves_by })
    }

    /// Its connection, and what came after what it wants.
    pub(super) fn into_parts(self: Box<Self>) -> (Channel, Inbox) {
        (self.channel, self.inbox)
    }

    /// What is to be waited for.
    pub(super) fn waits_for(&self) -> PollFd<'_> {
        self.channel.waits_for(!self.out.is_empty())
    }

    /// Whether it was told why it ends.
    pub(super) const fn is_leaving(&self) -> bool {
        self.leaves_by.is_some()
    }

    /// When its time is over.
    pub(super) fn deadline(&self, options: &ServeOptions) -> Instant {
        self.leaves_by.unwrap_or(self.came + options.hello_limit)
    }

    /// Goes on with it as far as that goes now.
    pub(super) fn look(&mut self, now: Instant, options: &ServeOptions) -> Look {
        if self.is_leaving() {
            return self.leave(now);
        }
        match self.listen(options) {
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

    fn listen(&mut self, options: &ServeOptions) -> io::Result<Look> {
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
                    let said = Introduction::of(&message);
                    return Ok(
                        said.map_or_else(|(why, text)| Look::Refused(why, text), |said| self.check(said, options))
                    );
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

    /// Whether it knows the secret, if there is one.
    fn check(&self, said: Introduction, options: &ServeOptions) -> Look {
        let key = options.secret.as_ref().zip(self.material.as_ref());
        let known = key.is_none_or(|(secret, material)| secret.is_proof(Side::Client, material, &said.proof));
        if known { Look::Introduced(said) } else { Look::Refused(Refusal::WrongSecret, String::new()) }
    }

    /// What shows it that the server knows the secret.
    pub(super) fn proof(&self, options: &ServeOptions) -> [u8; PROOF_LEN] {
        let key = options.secret.as_ref().zip(self.material.as_ref());
        key.map_or([0; PROOF_LEN], |(secret, material)| secret.prove(Side::Server, material))
    }

    /// Tells it why it is not taken.
    pub(super) fn refuse(&mut self, why: Refusal, text: &str, now: Instant) {
        // Whether it hears why is its affair.
        let _ = self.channel.stage(&Message::Refused { why, text }, &mut self.out);
        let _ = self.channel.push(&mut self.out);
        self.leaves_by = Some(now + FAREWELL);
        self.say_no_more();
    }

    fn say_no_more(&self) {
        if self.out.is_empty() {
            self.channel.end(false);
        }
    }

    /// Throws away what comes until the other end has closed: closing a connection with unread bytes in it would take away what
    /// was sent.
    fn leave(&mut self, now: Instant) -> Look {
        let was_empty = self.out.is_empty();
        if self.channel.push(&mut self.out).is_err() || now >= self.leaves_by.unwrap_or(now) {
            return Look::Ended(None);
        }
        if !was_empty {
            self.say_no_more();
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
