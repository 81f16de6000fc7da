//! The packet in flight, and how its answer is recognised.
//!
//! The driver sends the same packet in every exchange until its answer has come. Of two consecutive packets with the
//! same index and code the chip treats the second as INFO_UPDATE. So the command runs once however often it is sent,
//! and it does run if any of the copies arrives intact. If the only answer with the result was damaged, the answers to
//! later copies have the NOP flag and show that the command ran.

use super::start::StartStep;
use crate::ethercat::Ns;
use crate::xf::{AnswerHeader, CommandCode, Status};

/// How many answers with the NOP flag in a row, while the chip reports no rejected packet, show that the command ran
/// and its result is lost. `[OURS]` 2, since a single one proves nothing: it may answer a copy that the chip rejected,
/// and the chip's error count may show the rejection only later, since it may lag as the FIFO counts do. In that case
/// the next copy runs, and the next answer has its result.
const NOPS_OF_A_LOST_ANSWER: u32 = 2;
/// The number of copies of a packet that must be sent before its timeout takes effect. `[OURS]` 4: the answer to a copy
/// comes with the next copy, and one exchange in each direction may be damaged. A host that was suspended may have sent
/// only one copy when the timeout passes.
const COPIES_BEFORE_TIMEOUT: u32 = 4;

/// The step of a queued command that a packet carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CommandPart {
    /// The command itself, as it was submitted.
    Request,
    /// The second command of a pair, which reads the result of the first one.
    Read,
    /// Reading the abort code of an SDO transfer that failed.
    AbortCode,
}

/// What a packet was sent for, which decides what its answer is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Start(StartStep),
    /// INFO_UPDATE, which polls the header.
    Info,
    /// A queued command: the index of its slot in the queue, and the step of the command that is sent.
    Slot(usize, CommandPart),
    /// Process data: RxPDOs to write, TxPDOs to read, or both.
    Process {
        sequence: u32,
        /// Number of RxPDOs that the packet writes, into the FIFO or directly (PDO_DATA_OP).
        written: u8,
        /// Number of the written RxPDOs that go into the FIFO.
        queued: u8,
        reads: bool,
        /// Whether the packet's header clears, in each copy, the error bits that show that RxPDOs were rejected.
        clears: bool,
        /// Whether the error bits for rejected RxPDOs may come from an earlier packet that had no answer yet when this
        /// packet was sent.
        others: bool,
    },
}

/// What an answer shows about the packet in flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AnswerMatch {
    /// The packet's answer is still missing.
    Open,
    /// This is the packet's answer, with the result.
    Result,
    /// The command ran, but its result is lost.
    Lost,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Flight {
    pub(super) purpose: Purpose,
    pub(super) index: u8,
    pub(super) code: CommandCode,
    pub(super) copies: u32,
    /// The number of the exchange in which the first copy of the packet was sent.
    pub(super) first: u64,
    pub(super) since: Ns,
    pub(super) deadline: Ns,
    nops: u32,
}

impl Flight {
    /// A packet whose first copy is sent in this exchange.
    pub(super) const fn new(purpose: Purpose, index: u8, code: CommandCode, exchange: u64) -> Self {
        Self { purpose, index, code, copies: 1, first: exchange, since: 0, deadline: Ns::MAX, nops: 0 }
    }

    /// Sets the time of the first copy, and from it the deadline of the answer.
    pub(super) const fn within(self, since: Ns, answer_ns: Ns) -> Self {
        Self { since, deadline: since.saturating_add(answer_ns), ..self }
    }

    /// Whether the timeout of the packet's answer has passed and at least [`COPIES_BEFORE_TIMEOUT`] copies were sent.
    pub(super) const fn is_expired(&self, now: Ns) -> bool {
        now >= self.deadline && self.copies >= COPIES_BEFORE_TIMEOUT
    }

    /// Whether an answer has the packet's index and code.
    pub(super) fn matches(&self, header: &AnswerHeader) -> bool {
        header.index == self.index && header.code == self.code
    }

    /// Evaluates an answer. `rejected` says whether the answer shows that the chip has rejected a packet since the
    /// previous answer.
    pub(super) fn match_answer(&mut self, header: &AnswerHeader, rejected: bool) -> AnswerMatch {
        if rejected {
            self.nops = 0;
        }
        if !self.matches(header) {
            return AnswerMatch::Open;
        }
        if !header.status.contains(Status::NOP) {
            return AnswerMatch::Result;
        }
        if !rejected {
            self.nops += 1;
        }
        match self.purpose {
            // These packets have no result to lose. No source says whether their answers carry the NOP flag.
            Purpose::Info | Purpose::Start(StartStep::NotBusy) if !rejected => AnswerMatch::Result,
            _ if self.nops >= NOPS_OF_A_LOST_ANSWER && self.copies > NOPS_OF_A_LOST_ANSWER => AnswerMatch::Lost,
            _ => AnswerMatch::Open,
        }
    }
}
