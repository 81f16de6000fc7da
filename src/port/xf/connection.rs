//! The connection of a host to the server of a chip: it receives whole messages and sends answers. No call waits.

use std::io::{self, ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags};

use super::address::Stream;
use super::wire::{self, BadRequest, EXCHANGE_MAX, HEAD_LEN, Kind, Status};

/// The length of the longest message with its head, bytes.
const MESSAGE_MAX: usize = HEAD_LEN + EXCHANGE_MAX;

/// The reason why a host has left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Left {
    /// The host has sent a Close.
    Closed,
    /// The connection has ended without a Close, or has failed; the reason as text.
    Gone(String),
    /// The host has sent an invalid message.
    Broken(BadRequest),
}

impl From<io::Error> for Left {
    fn from(error: io::Error) -> Self {
        Self::Gone(error.to_string())
    }
}

/// The connection of the host that uses the chip.
pub(super) struct Connection {
    stream: Stream,
    /// The name of the host in the log.
    pub name: String,
    incoming: Box<[u8; MESSAGE_MAX]>,
    /// How many bytes at the front of `incoming` were received and not removed yet.
    held: usize,
    /// The length of the message at the front of `incoming` that [`Self::next`] has found; the next call of it removes
    /// this message.
    used: usize,
    outgoing: Box<[u8; MESSAGE_MAX]>,
    /// The range of `outgoing` that was not sent yet.
    unsent: std::ops::Range<usize>,
    /// Since when the connection waits for the host: for its first request, for the rest of a message, or until it
    /// reads an answer. `None`: it does not wait for the host.
    owes_since: Option<Instant>,
    /// Whether the host has sent a whole message. A connection without one may be from a program that is not a host (a
    /// port scan), so it must not keep others from the chip.
    has_asked: bool,
    limit: Duration,
}

impl Connection {
    /// Takes the connection of a host, and prepares the greeting for sending. `limit`: how long the host may take for
    /// its first request, for the rest of a message, and to read an answer.
    pub fn new(stream: Stream, name: String, limit: Duration) -> Self {
        let mut connection = Self {
            stream,
            name,
            incoming: Box::new([0; MESSAGE_MAX]),
            held: 0,
            used: 0,
            outgoing: Box::new([0; MESSAGE_MAX]),
            unsent: 0..0,
            owes_since: Some(Instant::now()),
            has_asked: false,
            limit,
        };
        let greeting = wire::greeting();
        connection.outgoing[..greeting.len()].copy_from_slice(&greeting);
        connection.unsent = 0..greeting.len();
        connection
    }

    /// The event to poll for: bytes to read, or room for bytes to send.
    pub fn poll_fd(&self) -> PollFd<'_> {
        self.stream.poll_fd(if self.unsent.is_empty() { PollFlags::IN } else { PollFlags::OUT })
    }

    /// The time limit of the present wait for the host; `None`: the connection does not wait for the host.
    pub fn deadline(&self) -> Option<Instant> {
        self.owes_since.map(|since| since + self.limit)
    }

    /// Whether a whole message has been received, which [`Self::answer`] then answers. The result is false until the
    /// answer to the previous message is sent. The error says why the host has left, or what is wrong with its message.
    pub fn next(&mut self, now: Instant) -> Result<bool, Left> {
        self.incoming.copy_within(self.used..self.held, 0);
        self.held -= std::mem::take(&mut self.used);
        if !self.send()? {
            return self.waits(now, "it does not read the answers");
        }
        loop {
            if let Some(head) = self.incoming[..self.held].first_chunk::<HEAD_LEN>() {
                let end = HEAD_LEN + wire::body_len(*head).map_err(Left::Broken)?;
                if self.held >= end {
                    (self.owes_since, self.has_asked) = (None, true);
                    self.used = end;
                    return Ok(true);
                }
            }
            match self.stream.read(&mut self.incoming[self.held..]) {
                Ok(0) if self.held > 0 => {
                    return Err(Left::Gone("its connection has ended within a message".to_owned()));
                }
                Ok(0) => return Err(Left::Gone("it has ended without a close".to_owned())),
                Ok(count) => self.held += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock && self.held == 0 && !self.has_asked => {
                    return self.waits(now, "no request has come");
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock && self.held == 0 => {
                    self.owes_since = None;
                    return Ok(false);
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    return self.waits(now, "the rest of a message has not come");
                }
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Records that the connection waits for the host. Returns `Ok(false)`, which means that there is no message yet,
    /// or an error with the text `what` if this wait has taken too long.
    fn waits(&mut self, now: Instant, what: &str) -> Result<bool, Left> {
        let since = *self.owes_since.get_or_insert(now);
        let waited = now.saturating_duration_since(since);
        if waited < self.limit {
            return Ok(false);
        }
        Err(Left::Gone(format!("{what} for {}", crate::span::Span(waited))))
    }

    /// Answers the message that [`Self::next`] has found. `fill` carries out the request. It gets the kind and the body
    /// of the message, the buffer for the body of the answer, and the stream, with which a long wait can detect that
    /// the host has disconnected. It returns the length of the answer's body, or status and text of a refusal.
    pub fn answer(
        &mut self,
        fill: impl FnOnce(u8, &[u8], &mut [u8], &Stream) -> Result<usize, (Status, String)>,
    ) -> Result<(), Left> {
        let kind = self.incoming[0];
        let body = &self.incoming[HEAD_LEN..self.used];
        let (status, len) = match fill(kind, body, &mut self.outgoing[HEAD_LEN..], &self.stream) {
            Ok(len) => (Status::Ok, len),
            Err((status, text)) => (status, put(&mut self.outgoing[HEAD_LEN..], &text)),
        };
        self.outgoing[..HEAD_LEN].copy_from_slice(&wire::head(kind, status, len));
        self.unsent = 0..HEAD_LEN + len;
        self.send()?;
        Ok(())
    }

    /// Ends a connection before its greeting was sent: a greeting with a status other than OK, and with the reason as
    /// text, is sent instead.
    pub fn refuse(&mut self, status: Status, text: &str) {
        self.unsent = 0..0;
        self.say_and_end(Kind::Greeting, status, text);
    }

    /// Sends a message that answers no request, for example a Close, and ends the connection. Bytes for which the
    /// socket has no room are not sent.
    pub fn say_and_end(&mut self, kind: Kind, status: Status, text: &str) {
        // If a part of an answer is still unsent, the host would take this message for the rest of the answer, so it is
        // not sent.
        if self.unsent.is_empty() {
            let len = put(&mut self.outgoing[HEAD_LEN..], text);
            self.outgoing[..HEAD_LEN].copy_from_slice(&wire::head(kind as u8, status, len));
            self.unsent = 0..HEAD_LEN + len;
        }
        // If this fails, the host can no longer receive, and its connection ends without this message.
        let _ = self.send();
        self.end();
    }

    /// Ends the connection. Received bytes are read first: closing a socket with unread bytes makes the system reset
    /// the connection, and the host might lose the last answer.
    pub fn end(&mut self) {
        self.stream.end_output();
        for _ in 0..ROUNDS_AT_END {
            if !matches!(self.stream.read(&mut self.incoming[..]), Ok(1..)) {
                return;
            }
        }
    }

    /// Sends the remaining bytes. Returns whether all are sent.
    fn send(&mut self) -> io::Result<bool> {
        while !self.unsent.is_empty() {
            match self.stream.write(&self.outgoing[self.unsent.clone()]) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => {
                    self.unsent.start += count;
                    // Before the first request of the host, its time limit continues to run even after the greeting was
                    // sent. Later, sending ends the present wait.
                    self.owes_since = self.owes_since.filter(|_| !self.has_asked);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(error) => return Err(error),
            }
        }
        Ok(true)
    }
}

/// How many times [`Connection::end`] reads and discards received bytes at most. \[OURS]
const ROUNDS_AT_END: usize = 16;

/// Copies a text, as many whole characters as fit into `room`. Returns the number of bytes.
fn put(room: &mut [u8], text: &str) -> usize {
    let len = text.floor_char_boundary(room.len());
    room[..len].copy_from_slice(&text.as_bytes()[..len]);
    len
}
