//! What server and clients say to each other; how it looks as bytes says [`super::wire`].

use super::proof::PROOF_LEN;
use crate::engine::Counters;
use crate::link::{ReadMeta, Stamp, Wait};
use crate::sk::{FRAME_LEN, SlotSize};

/// What a client wants to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// It gets every report and may write: one at a time.
    #[default]
    Writer,
    /// It gets every report.
    Reader,
}

/// What a client says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hello<'a> {
    /// What it wants to be.
    pub role: Role,
    /// It says something at least this often, milliseconds.
    pub keepalive_ms: u32,
    /// Its process.
    pub pid: u32,
    /// Its program.
    pub program: &'a str,
    /// That it knows the secret; zeros where there is none.
    pub proof: &'a [u8; PROOF_LEN],
}

/// What a server says of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Welcome<'a> {
    /// That it knows the secret; zeros where there is none.
    pub proof: &'a [u8; PROOF_LEN],
    /// The board's slot size, if the server's link knows it.
    pub slot: Option<SlotSize>,
    /// Whether time passes by the writer's calls only.
    pub virtual_time: bool,
    /// Time of the board.
    pub now: Stamp,
    /// Sequence number of the next report.
    pub sequence: u64,
    /// The server's link.
    pub board: &'a str,
    /// The slaves, as [`KnownNetwork::slaves`](crate::link::KnownNetwork::slaves).
    pub slaves: &'a str,
    /// Units of the axes, as [`KnownNetwork::counts_per_unit`](crate::link::KnownNetwork::counts_per_unit).
    pub counts_per_unit: &'a str,
}

/// Why a server does not take a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Refusal {
    /// Somebody else is the writer; the text says who.
    HasWriter = 1,
    /// The board is away; the text says why.
    NoBoard = 2,
    /// As many clients as it takes.
    Full = 3,
    /// The client does not know the secret.
    WrongSecret = 4,
    /// What it said is no hello.
    NoHello = 5,
}

/// Why a connection is ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum End {
    /// The client has closed its link.
    Closed = 1,
    /// The server is stopped.
    Stopped = 2,
    /// The board is gone; the text says why.
    Lost = 3,
    /// The other end does not keep to the protocol; the text says how.
    Broken = 4,
}

/// Counters of a server's link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Reports dropped because nobody read them, before the server and in it.
    pub reports_dropped: u64,
    /// The board's counters, where the server's link sees them.
    pub board: Option<Counters>,
}

/// Why a request failed: [`LinkError`] as it travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failure<'a> {
    pub(super) code: u8,
    pub(super) numbers: [u64; 2],
    pub(super) text: &'a str,
}

/// One message. Those up to `Bye` are a client's, those from `Ping` on a server's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message<'a> {
    /// The first.
    Hello(Hello<'a>),
    /// A command frame.
    Write {
        /// Its number.
        request: u64,
        /// How long the server's link may wait.
        wait: Wait,
        /// The frame.
        frame: &'a [u8; FRAME_LEN],
    },
    /// Virtual time alone: the oldest report not yet read.
    Read {
        /// Its number.
        request: u64,
        /// How long, in the board's time.
        wait: Wait,
    },
    /// Virtual time alone: lets it pass.
    Pass {
        /// Its number.
        request: u64,
        /// Nanoseconds.
        ns: u64,
    },
    /// Asks for counters.
    Count {
        /// Its number.
        request: u64,
    },
    /// Ends the write under way.
    Cancel {
        /// Its number.
        request: u64,
    },
    /// The other end is there.
    Ping,
    /// The last.
    Bye {
        /// Why.
        end: End,
        /// In words.
        text: &'a str,
    },
    /// The client is taken.
    Welcome(Welcome<'a>),
    /// The client is not taken.
    Refused {
        /// Why.
        why: Refusal,
        /// In words.
        text: &'a str,
    },
    /// A report that the board made.
    Report {
        /// Its meta data, of the server's link; `dropped` with those that were dropped for this client.
        meta: ReadMeta,
        /// The report.
        frame: &'a [u8; FRAME_LEN],
    },
    /// The board has taken the frame.
    Written {
        /// Of which request.
        request: u64,
        /// When.
        at: Stamp,
        /// Time of the board after it, on virtual time.
        now: Option<Stamp>,
    },
    /// Virtual time alone: the report.
    Got {
        /// Of which request.
        request: u64,
        /// Time of the board after it.
        now: Option<Stamp>,
        /// Its meta data.
        meta: ReadMeta,
        /// The report.
        frame: &'a [u8; FRAME_LEN],
    },
    /// Time has passed.
    Passed {
        /// Of which request.
        request: u64,
        /// Time of the board after it.
        now: Option<Stamp>,
    },
    /// Counters.
    Counted {
        /// Of which request.
        request: u64,
        /// They.
        counts: Counts,
    },
    /// A request failed, and nothing of it was done.
    Failed {
        /// Which.
        request: u64,
        /// Time of the board after it, on virtual time.
        now: Option<Stamp>,
        /// Why.
        failure: Failure<'a>,
    },
}
