//! The packet that waits for its answer, and when the answer is there.
//!
//! The same packet is sent in every exchange until its answer has come. Since the chip takes the second of two
//! consecutive packets with the same index and code for INFO_UPDATE, the command runs once however often it is sent,
//! and it does run if any of the copies arrives whole. If its one answer was damaged, those to the copies behind it
//! have the NOP flag and show that it ran.

use super::start::StartStep;
use crate::ethercat::Ns;
use crate::xf::{AnswerHeader, CommandCode, Status};

/// After so many answers with the NOP flag in a row, without a sign that the chip rejected a copy, the command ran and
/// its result is lost. `[OURS]` 2: one could be the answer to a copy that was rejected, if the chip's count of errors
/// lags behind as its counts of FIFO entries do; the copy after it then runs and has its result in the next answer.
const NOPS_OF_A_LOST_ANSWER: u32 = 2;

/// Which part of a command in the queue a packet is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// The command itself.
    Request,
    /// The read of its result.
    Read,
    /// The read of its abort code.
    AbortCode,
}

/// What a packet is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Start(StartStep),
    /// A new header.
    Info,
    /// A command of the queue.
    Slot(usize, Part),
    /// Process data.
    Process {
        sequence: u32,
        /// RxPDOs that are written.
        written: u8,
        /// Those of them that go into the FIFO.
        queued: u8,
        reads: bool,
        /// Its header clears the errors by which it is seen that RxPDOs were not taken, in each of its copies.
        clears: bool,
        /// These errors may be those of a packet before, whose answer was not there when this one was sent.
        others: bool,
    },
}

/// What an answer means for the packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It is not the answer.
    Open,
    /// It has the result.
    Result,
    /// The command ran; its result is lost.
    Lost,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Flight {
    pub(super) purpose: Purpose,
    pub(super) index: u8,
    pub(super) code: CommandCode,
    pub(super) copies: u32,
    /// The exchange of the first copy.
    pub(super) first: u64,
    pub(super) since: Ns,
    pub(super) deadline: Ns,
    nops: u32,
}

impl Flight {
    /// A packet whose first copy is sent now, in this exchange.
    pub(super) const fn new(purpose: Purpose, index: u8, code: CommandCode, exchange: u64) -> Self {
        Self { purpose, index, code, copies: 1, first: exchange, since: 0, deadline: Ns::MAX, nops: 0 }
    }

    /// The same packet with the times of its first copy and its end.
    pub(super) const fn within(self, since: Ns, answer_ns: Ns) -> Self {
        Self { since, deadline: since.saturating_add(answer_ns), ..self }
    }

    /// Whether an answer has the packet's index and code.
    pub(super) fn matches(&self, header: &AnswerHeader) -> bool {
        header.index == self.index && header.code == self.code
    }

    /// Takes an answer. `rejected` is whether it shows that the chip rejected a packet since the answer before.
    pub(super) fn judge(&mut self, header: &AnswerHeader, rejected: bool) -> Verdict {
        if rejected {
            self.nops = 0;
        }
        if !self.matches(header) {
            return Verdict::Open;
        }
        if !header.status.contains(Status::NOP) {
            return Verdict::Result;
        }
        if !rejected {
            self.nops += 1;
        }
        match self.purpose {
            // There is no result that could be lost, and whether its answers have the flag no source says.
            Purpose::Info | Purpose::Start(StartStep::NotBusy) if !rejected => Verdict::Result,
            _ if self.nops >= NOPS_OF_A_LOST_ANSWER && self.copies > NOPS_OF_A_LOST_ANSWER => Verdict::Lost,
            _ => Verdict::Open,
        }
    }
}
