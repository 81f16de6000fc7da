//! A server without sockets and threads, for tests on virtual time. Its clients are values that pass bytes to it and
//! disconnect when the test wants it.

use std::sync::Arc;
use std::time::Duration;

use super::ServeOptions;
use super::board::Board;
use super::client::Client;
use super::hub::{Hub, Joining};
use super::session::{Introduction, Left, Session};
use super::vanish;
use crate::engine::Counters;
use crate::link::{Link, Stamp, Wait};
use crate::notes::Note;
use crate::sk::Frame;
use crate::tcp::wire::{End, Hello, MESSAGE_MAX, Message, Role, WireError};
use crate::tcp::{Inbox, PROOF_LEN, each_message};

/// A server without sockets for a link on virtual time. Its log lines are collected for [`told`](Self::told).
pub struct InMemoryServer {
    hub: Arc<Hub>,
    board: Arc<Board>,
}

/// A message that a test lets a client send.
#[derive(Clone, Copy, Debug)]
pub enum ClientMessage<'a> {
    /// A request to write a command frame.
    Write(&'a Frame),
    /// A request for the oldest unread report.
    Read,
    /// A request to advance the board's time.
    Pass(Duration),
    /// A request for the counters of the link and its board.
    Count,
    /// Cancels the previous request.
    Cancel,
    /// A keep-alive message.
    Ping,
    /// A request of a client that joined by [`InMemoryServer::join_stopper`]: the axes are stopped.
    Stop {
        /// Whether the axes are switched off then.
        off: bool,
    },
    /// The client's last message: it closes its link.
    Bye,
}

/// A message of the server to a client. Requests are numbered in the order in which the client makes them, from 1.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "they are looked at one by one and never stored in bulk")]
pub enum ServerMessage {
    /// A request has succeeded.
    Done {
        /// The number of the request, counted from 1.
        request: u64,
        /// The board's time after the request; `None` if it is unknown.
        now: Option<Stamp>,
    },
    /// The answer to a request for the counters.
    Counted {
        /// The number of the request, counted from 1.
        request: u64,
        /// The number of reports that were dropped for the client.
        reports_dropped: u64,
        /// The counters of the board, if its link has them. Otherwise `None`.
        board: Option<Counters>,
    },
    /// A request has failed.
    Failed {
        /// The number of the request, counted from 1.
        request: u64,
        /// The board's time after the request; `None` if it is unknown.
        now: Option<Stamp>,
    },
    /// The answer to a stop: it has ended.
    Stopped {
        /// The number of the request, counted from 1.
        request: u64,
        /// The name of the writer that was stopped; empty if there was none.
        writer: String,
    },
    /// The server's last message: it ends the connection.
    Bye,
    /// Another message of the server (Welcome, report, answer to a ping), which these tests do not check.
    Other,
}

/// A client of an [`InMemoryServer`].
pub struct InMemoryClient<'a> {
    server: &'a InMemoryServer,
    session: Session<'a>,
    client: Arc<Client>,
    inbox: Inbox,
    requests: u64,
}

impl InMemoryServer {
    /// Creates a server for this link.
    pub fn new(link: Arc<dyn Link>, options: ServeOptions) -> Self {
        let hub = Arc::new(Hub::new(options));
        let board = hub.attach(link);
        Self { hub, board }
    }

    /// Takes the log lines since the last call of this function.
    pub fn told(&self) -> Vec<String> {
        let note = |note| match note {
            Note::Item(line) => line,
            Note::Dropped(count) => format!("{count} lines were dropped"),
        };
        std::iter::from_fn(|| self.hub.notes.take()).map(note).collect()
    }

    /// Connects a client as a writer or a reader; `None` if it is refused.
    pub fn join(&self, is_writer: bool) -> Option<InMemoryClient<'_>> {
        self.join_as(if is_writer { Role::Writer } else { Role::Reader })
    }

    /// Connects a client that asks for a stop; `None` if it is refused.
    pub fn join_stopper(&self) -> Option<InMemoryClient<'_>> {
        self.join_as(Role::Stopper)
    }

    fn join_as(&self, role: Role) -> Option<InMemoryClient<'_>> {
        let hello = Hello { role, keepalive_ms: 500, pid: 1, program: "unwired", proof: &[0; PROOF_LEN] };
        let Introduction { role, keepalive, name, .. } = Introduction::of(&Message::Hello(hello)).ok()?;
        let mut joining = Joining { who: name, role, keepalive, proof: &[0; PROOF_LEN], channel: None };
        let (client, board) = self.hub.join(&mut joining).ok()?;
        let session = Session::new(&self.hub, board, Arc::clone(&client));
        Some(InMemoryClient { server: self, session, client, inbox: Inbox::default(), requests: 0 })
    }
}

impl InMemoryClient<'_> {
    /// Sends the first `bytes` bytes of a message, so that tests can cut messages, and executes the request. Returns
    /// whether the client is still connected.
    pub fn say(&mut self, what: ClientMessage<'_>, bytes: usize) -> bool {
        let keeps = self.begin(what, bytes);
        while keeps && self.session.is_busy() {
            self.session.work();
        }
        keeps
    }

    /// Like [`say`](Self::say), but a request that takes several steps is only begun. Returns whether the client is
    /// still connected.
    pub fn begin(&mut self, what: ClientMessage<'_>, bytes: usize) -> bool {
        self.requests += 1;
        let request = self.requests;
        let message = match what {
            ClientMessage::Write(frame) => Message::Write { request, wait: Wait::Forever, frame: frame.bytes() },
            ClientMessage::Read => Message::Read { request, wait: Wait::For(Duration::from_secs(1)) },
            ClientMessage::Pass(time) => {
                Message::Pass { request, ns: u64::try_from(time.as_nanos()).unwrap_or(u64::MAX) }
            }
            ClientMessage::Count => Message::Count { request },
            ClientMessage::Cancel => Message::Cancel { request: request - 1 },
            ClientMessage::Ping => Message::Ping,
            ClientMessage::Stop { off } => Message::Stop { request, off },
            ClientMessage::Bye => Message::Bye { end: End::Closed, text: "" },
        };
        let mut said = [0; MESSAGE_MAX];
        let length = message.encode(&mut said).min(bytes);
        self.hear(&said[..length])
    }

    /// Sends any bytes to the server. Returns whether the client is still connected.
    pub fn hear(&mut self, mut bytes: &[u8]) -> bool {
        if self.session.check_dismissed().is_err() {
            return false;
        }
        while !bytes.is_empty() {
            bytes = self.inbox.fill(bytes);
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

    /// Executes one step of the request in progress. Returns whether this request needs further steps.
    pub fn work(&mut self) -> bool {
        self.session.work();
        self.session.is_busy()
    }

    /// The length of a Write message in bytes; for any other message the maximum length of messages.
    pub fn length(what: ClientMessage<'_>) -> usize {
        match what {
            ClientMessage::Write(frame) => {
                let write = Message::Write { request: 0, wait: Wait::Forever, frame: frame.bytes() };
                write.encode(&mut [0; MESSAGE_MAX])
            }
            _ => MESSAGE_MAX,
        }
    }

    /// The bytes that the server has sent since the last call.
    pub fn take_sent(&self) -> Vec<u8> {
        self.client.take_sent()
    }

    /// The messages that the server has sent since the last call.
    ///
    /// # Errors
    /// The first invalid message.
    pub fn take_messages(&self) -> Result<Vec<ServerMessage>, WireError> {
        let mut all = Vec::new();
        each_message(&self.take_sent(), |message| all.push(ServerMessage::from(message)))?;
        Ok(all)
    }

    /// Ends the client's connection, with or without a Bye.
    pub fn end(self, says_bye: bool) {
        let left = if says_bye { Left::Closed } else { Left::Gone("its connection has ended".to_owned()) };
        let Self { server, client, session, .. } = self;
        drop(session);
        vanish::client_left(&server.hub, &server.board, &client, &left);
    }
}

impl From<&Message<'_>> for ServerMessage {
    fn from(message: &Message<'_>) -> Self {
        match *message {
            Message::Written { request, now, .. }
            | Message::Got { request, now, .. }
            | Message::Passed { request, now } => Self::Done { request, now },
            Message::Failed { request, now, .. } => Self::Failed { request, now },
            Message::Stopped { request, writer, .. } => Self::Stopped { request, writer: writer.to_owned() },
            Message::Counted { request, counts } => {
                Self::Counted { request, reports_dropped: counts.reports_dropped, board: counts.board }
            }
            Message::Bye { .. } => Self::Bye,
            _ => Self::Other,
        }
    }
}
