//! The messages between server and clients. [`super::wire`] defines their bytes.

use super::proof::PROOF_LEN;
use crate::engine::Counters;
use crate::link::{ReadMeta, Stamp, Wait};
use crate::sk::{FRAME_LEN, SlotSize};

/// The rights of a client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// The client receives every report and may send commands. There is at most one writer.
    #[default]
    Writer,
    /// The client receives every report, but must not send commands.
    Reader,
    /// The client has axes stopped ([`Message::Stop`]). It receives no reports, and does not count towards the limit of
    /// clients.
    Stopper,
    /// The client asks for the machine file of the server ([`Message::Ask`]). It receives no reports, and does not
    /// count towards the limit of clients. A server of an older version does not know this role and refuses the
    /// client's Hello ([`Refusal::NoHello`]).
    Asker,
}

/// A client's first message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hello<'a> {
    /// The role that the client asks for.
    pub role: Role,
    /// The client sends a message at least this often, in milliseconds. If four such times pass without a message, the
    /// server considers the client dead.
    pub keepalive_ms: u32,
    /// The process id of the client.
    pub pid: u32,
    /// The name of the client's program.
    pub program: &'a str,
    /// The proof that the client knows the secret, made from the keying material of the TLS session; zeros without a secret.
    pub proof: &'a [u8; PROOF_LEN],
}

/// The server's answer to a client that it accepts, with its information about the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Welcome<'a> {
    /// The proof that the server knows the secret, made from the keying material of the TLS session; zeros without a secret.
    pub proof: &'a [u8; PROOF_LEN],
    /// The board's slot size, if the server's link knows it.
    pub slot: Option<SlotSize>,
    /// Whether the board's time advances only by the writer's calls.
    pub virtual_time: bool,
    /// The latest known time of the board when the Welcome was sent; on the real clock that of the newest report.
    pub now: Stamp,
    /// The sequence number of the next report that the server sends.
    pub sequence: u64,
    /// The URI with which the server has opened the board.
    pub board: &'a str,
    /// The slaves, as in [`KnownNetwork::slaves`](crate::link::KnownNetwork::slaves).
    pub slaves: &'a str,
    /// The units of the axes, as in [`KnownNetwork::counts_per_unit`](crate::link::KnownNetwork::counts_per_unit).
    pub counts_per_unit: &'a str,
}

/// Why a server refuses a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Refusal {
    /// Another client is the writer; the text names it.
    HasWriter = 1,
    /// The board is not connected; the text has the reason.
    NoBoard = 2,
    /// The server has as many clients as it allows.
    Full = 3,
    /// The client's proof is wrong: it has another secret, or none.
    WrongSecret = 4,
    /// The client's first message is invalid.
    NoHello = 5,
}

/// Why a connection ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum End {
    /// The client has closed its link.
    Closed = 1,
    /// The server is being stopped.
    Stopped = 2,
    /// The board is lost; the text has the reason.
    Lost = 3,
    /// The other end has violated the protocol; the text has the details.
    Broken = 4,
    /// Another client, which the text names, has the axes of this writer stopped.
    Overruled = 5,
}

/// How a stop that a client has asked for has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum StopEnd {
    /// All axes stand still.
    Stand = 1,
    /// The network is not in OP, so that no axis follows commands.
    NotInOp = 2,
    /// The server has not seen the configuration of the network, so it does not know the axes: moving axes continue to
    /// move.
    Unknown = 3,
    /// The stop has failed, and axes may still move; the text has the reason.
    Failed = 4,
}

/// The counters that the server gives for its link to the board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// The number of reports that were dropped for a client: by the server's link to the board, and by the server,
    /// because the client did not receive them in time.
    pub reports_dropped: u64,
    /// The counters of the board, if the server's link has them.
    pub board: Option<Counters>,
}

/// Why a request failed: a [`LinkError`](crate::link::LinkError) in the form in which it is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failure<'a> {
    pub(super) code: u8,
    pub(super) numbers: [u64; 2],
    pub(super) text: &'a str,
}

/// A message. Clients send the variants from `Hello` to `Bye`, servers those from `Ping` to `Machine`, so both send `Ping` and
/// `Bye`. The client numbers its requests, and each answer repeats the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message<'a> {
    /// A client's first message.
    Hello(Hello<'a>),
    /// A request to write a command frame.
    Write {
        /// The number of the request.
        request: u64,
        /// How long the server may wait until the board accepts the frame.
        wait: Wait,
        /// The command frame.
        frame: &'a [u8; FRAME_LEN],
    },
    /// A request for the oldest unread report. On virtual time only, where a read advances the board's time; on the real clock
    /// the server sends every report unasked.
    Read {
        /// The number of the request.
        request: u64,
        /// How long the read may wait for a report, in the board's time; then it fails with a timeout.
        wait: Wait,
    },
    /// On virtual time only: a request to advance the board's time.
    Pass {
        /// The number of the request.
        request: u64,
        /// The time to advance, in nanoseconds.
        ns: u64,
    },
    /// A request for the counters of the server's link and its board.
    Count {
        /// The number of the request.
        request: u64,
    },
    /// A request to cancel a write that is in progress.
    Cancel {
        /// The number of the write request.
        request: u64,
    },
    /// A request of a stopper: the server ends the connection of the writer, if there is one, and brings the axes to a
    /// standstill, as after a writer that has vanished.
    Stop {
        /// The number of the request.
        request: u64,
        /// Whether the axes are switched off when they stand.
        off: bool,
    },
    /// A request of an asker for a part of the machine file.
    Ask {
        /// The number of the request.
        request: u64,
        /// Where the part begins in the file, bytes.
        from: u32,
    },
    /// The keep-alive message, which both ends send if they have nothing else to send.
    Ping,
    /// The last message of a client or server before it closes the connection.
    Bye {
        /// Why the connection ends.
        end: End,
        /// The details as text, for example why the board is lost.
        text: &'a str,
    },
    /// The server accepts the client.
    Welcome(Welcome<'a>),
    /// The server refuses the client.
    Refused {
        /// The reason of the refusal.
        why: Refusal,
        /// The details as text, for example the name of the present writer.
        text: &'a str,
    },
    /// A report of the board.
    Report {
        /// Time and sequence number of the report on the server's link. `dropped` is the number of reports that this client
        /// lacks so far, because the server or its link has dropped them.
        meta: ReadMeta,
        /// The report.
        frame: &'a [u8; FRAME_LEN],
    },
    /// The answer to a write: the board has accepted the frame.
    Written {
        /// The number of the request.
        request: u64,
        /// The board's time when it accepted the frame, on the clock of the reports' stamps.
        at: Stamp,
        /// The board's time after the write; `None` on the real clock, and if it is unknown.
        now: Option<Stamp>,
    },
    /// The answer to a read.
    Got {
        /// The number of the request.
        request: u64,
        /// The board's time after the read; `None` on the real clock, and if it is unknown.
        now: Option<Stamp>,
        /// The time and the sequence number of the report on the server's link.
        meta: ReadMeta,
        /// The report.
        frame: &'a [u8; FRAME_LEN],
    },
    /// The answer to a request to advance the time.
    Passed {
        /// The number of the request.
        request: u64,
        /// The board's time after the request; `None` on the real clock, and if it is unknown.
        now: Option<Stamp>,
    },
    /// The answer to a request for the counters.
    Counted {
        /// The number of the request.
        request: u64,
        /// The counters of the server's link.
        counts: Counts,
    },
    /// The answer to a request that has failed and that had no effect on the board.
    Failed {
        /// The number of the request.
        request: u64,
        /// The board's time after the request; `None` on the real clock, and if it is unknown.
        now: Option<Stamp>,
        /// The reason of the failure.
        failure: Failure<'a>,
    },
    /// The answer to a request to stop the axes, once they stand.
    Stopped {
        /// The number of the request.
        request: u64,
        /// How the stop has ended.
        end: StopEnd,
        /// The name of the writer that was stopped; empty if there was none.
        writer: &'a str,
        /// The details as text, for example why the stop has failed; may be empty.
        text: &'a str,
    },
    /// The answer to a request for a part of the machine file.
    Machine {
        /// The number of the request.
        request: u64,
        /// The length of the whole file, bytes; 0: the server has none.
        length: u32,
        /// The name of the file.
        name: &'a str,
        /// The part; empty at the end of the file.
        part: &'a [u8],
    },
}
