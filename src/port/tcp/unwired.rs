//! A server without sockets and threads, for tests: its clients are bytes and end as the test says, on virtual time.

use std::sync::Arc;
use std::time::Duration;

use super::ServeOptions;
use super::client::Client;
use super::hub::{Board, Guest, Hub};
use super::session::{Introduction, Left, Session};
use super::vanish;
use crate::engine::Counters;
use crate::link::tcp::wire::{End, Hello, MESSAGE_MAX, Message, Role, WireError};
use crate::link::tcp::{Inbox, PROOF_LEN, each_message};
use crate::link::{Link, Stamp, Wait};
use crate::port::notes::Note;
use crate::sk::Frame;

/// The server of a link on virtual time. Nobody takes what it tells people.
pub struct Unwired {
    hub: Arc<Hub>,
    board: Arc<Board>,
}

/// What a client sends.
#[derive(Clone, Copy, Debug)]
pub enum Says<'a> {
    /// A command frame.
    Write(&'a Frame),
    /// A read of the oldest report.
    Read,
    /// Time is to pass.
    Pass(Duration),
    /// What was counted since it came.
    Count,
    /// The request before it is not wanted any more.
    Cancel,
    /// It is there.
    Ping,
    /// Good-bye.
    Bye,
}

/// What a server has sent to a client. Requests have numbers: 1 is the first thing that a client says, 2 the next one.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "they are looked at one by one and never stored in bulk")]
pub enum Sent {
    /// A request was done, with the board's time.
    Done {
        /// Its number.
        request: u64,
        /// When.
        now: Option<Stamp>,
    },
    /// What was counted.
    Counted {
        /// Its number.
        request: u64,
        /// Reports that the client did not get.
        reports_dropped: u64,
        /// What the board has counted.
        board: Option<Counters>,
    },
    /// A request was not done.
    Failed {
        /// Its number.
        request: u64,
        /// When.
        now: Option<Stamp>,
    },
    /// Good-bye.
    Bye,
    /// What is no answer.
    Other,
}

/// A client of it.
pub struct Caller<'a> {
    server: &'a Unwired,
    session: Session<'a>,
    client: Arc<Client>,
    inbox: Inbox,
    requests: u64,
}

impl Unwired {
    /// Serves a link.
    pub fn new(link: Arc<dyn Link>, options: ServeOptions) -> Self {
        let hub = Arc::new(Hub::new(options));
        let board = hub.attach(link);
        Self { hub, board }
    }

    /// What people would have been told since the last time.
    pub fn told(&self) -> Vec<String> {
        let note = |note| match note {
            Note::Told(line) => line,
            Note::Dropped(count) => format!("{count} lines were dropped"),
        };
        std::iter::from_fn(|| self.hub.notes.take()).map(note).collect()
    }

    /// A client comes, as a writer or a reader; `None`: it is refused.
    pub fn join(&self, is_writer: bool) -> Option<Caller<'_>> {
        let role = if is_writer { Role::Writer } else { Role::Reader };
        let hello = Hello { role, keepalive_ms: 500, pid: 1, program: "unwired", proof: &[0; PROOF_LEN] };
        let Introduction { role, keepalive, name, .. } = Introduction::of(&Message::Hello(hello)).ok()?;
        let mut guest = Guest { who: name, role, keepalive, proof: &[0; PROOF_LEN], channel: None };
        let (client, board) = self.hub.join(&mut guest).ok()?;
        let session = Session::new(&self.hub, board, Arc::clone(&client));
        Some(Caller { server: self, session, client, inbox: Inbox::default(), requests: 0 })
    }
}

impl Caller<'_> {
    /// Says something, of which the first `bytes` bytes come, and has it done; says whether the server still keeps the client.
    pub fn say(&mut self, what: Says<'_>, bytes: usize) -> bool {
        let keeps = self.begin(what, bytes);
        while keeps && self.session.is_busy() {
            self.session.work();
        }
        keeps
    }

    /// As [`say`](Self::say), but what takes several steps is only begun.
    pub fn begin(&mut self, what: Says<'_>, bytes: usize) -> bool {
        self.requests += 1;
        let request = self.requests;
        let message = match what {
            Says::Write(frame) => Message::Write { request, wait: Wait::Forever, frame: frame.bytes() },
            Says::Read => Message::Read { request, wait: Wait::For(Duration::from_secs(1)) },
            Says::Pass(time) => Message::Pass { request, ns: u64::try_from(time.as_nanos()).unwrap_or(u64::MAX) },
            Says::Count => Message::Count { request },
            Says::Cancel => Message::Cancel { request: request - 1 },
            Says::Ping => Message::Ping,
            Says::Bye => Message::Bye { end: End::Closed, text: "" },
        };
        let mut said = [0; MESSAGE_MAX];
        let length = message.encode(&mut said).min(bytes);
        self.hear(&said[..length])
    }

    /// These bytes come; says whether the server still keeps the client.
    pub fn hear(&mut self, mut bytes: &[u8]) -> bool {
        while !bytes.is_empty() {
            let room = self.inbox.room();
            let count = room.len().min(bytes.len());
            room[..count].copy_from_slice(&bytes[..count]);
            bytes = &bytes[count..];
            self.inbox.came(count);
            loop {
                match self.inbox.next() {
                    Ok(None) => break,
                    Ok(Some(message)) if self.session.take(&message).is_ok() => {}
                    Ok(Some(_)) | Err(_) => return false,
                }
            }
        }
        !self.client.is_over()
    }

    /// Goes on with what was begun, for one step; says whether there is more to do.
    pub fn work(&mut self) -> bool {
        self.session.work();
        self.session.is_busy()
    }

    /// How many bytes that would be.
    pub fn length(what: Says<'_>) -> usize {
        match what {
            Says::Write(frame) => {
                let write = Message::Write { request: 0, wait: Wait::Forever, frame: frame.bytes() };
                write.encode(&mut [0; MESSAGE_MAX])
            }
            _ => MESSAGE_MAX,
        }
    }

    /// What the server has sent since the last time.
    pub fn take_sent(&self) -> Vec<u8> {
        self.client.take_sent()
    }

    /// As [`take_sent`](Self::take_sent), understood.
    ///
    /// # Errors
    /// The first message that is none.
    pub fn take_messages(&self) -> Result<Vec<Sent>, WireError> {
        let mut all = Vec::new();
        each_message(&self.take_sent(), |message| all.push(Sent::from(message)))?;
        Ok(all)
    }

    /// The client is gone; with a good-bye or without one.
    pub fn end(self, says_bye: bool) {
        let left = if says_bye { Left::Closed } else { Left::Gone("its connection has ended".to_owned()) };
        let Self { server, client, session, .. } = self;
        drop(session);
        vanish::part(&server.hub, &server.board, &client, &left);
    }
}

impl From<&Message<'_>> for Sent {
    fn from(message: &Message<'_>) -> Self {
        match *message {
            Message::Written { request, now, .. }
            | Message::Got { request, now, .. }
            | Message::Passed { request, now } => Self::Done { request, now },
            Message::Failed { request, now, .. } => Self::Failed { request, now },
            Message::Counted { request, counts } => {
                Self::Counted { request, reports_dropped: counts.reports_dropped, board: counts.board }
            }
            Message::Bye { .. } => Self::Bye,
            _ => Self::Other,
        }
    }
}
