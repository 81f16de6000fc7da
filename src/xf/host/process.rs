//! Process data that wait for their exchange, and what became of those that have gone out.

use super::error::HostError;
use crate::xf::request::{Arguments, PdoOperation};
use crate::xf::{CommandCode, Errors};

/// Reports that are kept until they are taken.
const REPORTS: usize = 4;

/// The errors that a write leaves which the chip did not take.
pub(super) const NOT_TAKEN: Errors = Errors::FIFO.with(Errors::COMMAND);

/// Process data for one exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessData<'d> {
    /// RxPDOs into the FIFO, and as many TxPDOs out of it: PDO_DATA_FIFO_OP.
    Exchange {
        /// How many PDOs.
        count: u8,
        /// The RxPDOs one after the other.
        outputs: &'d [u8],
    },
    /// RxPDOs into the FIFO alone.
    Write {
        /// How many PDOs.
        count: u8,
        /// The RxPDOs one after the other.
        outputs: &'d [u8],
    },
    /// TxPDOs out of the FIFO alone.
    Read {
        /// How many PDOs at most.
        count: u8,
    },
    /// One RxPDO and one TxPDO past the FIFO: PDO_DATA_OP.
    DirectExchange {
        /// The RxPDO.
        outputs: &'d [u8],
    },
    /// One TxPDO past the FIFO, as to learn positions.
    DirectRead,
}

impl<'d> ProcessData<'d> {
    /// What they are, and the RxPDOs.
    pub(super) fn parts(self) -> (ProcessKind, &'d [u8]) {
        match self {
            Self::Exchange { count, outputs } => (ProcessKind::Exchange { count }, outputs),
            Self::Write { count, outputs } => (ProcessKind::Write { count }, outputs),
            Self::Read { count } => (ProcessKind::Read { count }, &[]),
            Self::DirectExchange { outputs } => (ProcessKind::DirectExchange, outputs),
            Self::DirectRead => (ProcessKind::DirectRead, &[]),
        }
    }
}

/// What process data are, without the RxPDOs themselves: [`Host::process_in_place`](super::Host::process_in_place).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessKind {
    /// [`ProcessData::Exchange`]
    Exchange {
        /// How many PDOs.
        count: u8,
    },
    /// [`ProcessData::Write`]
    Write {
        /// How many PDOs.
        count: u8,
    },
    /// [`ProcessData::Read`]
    Read {
        /// How many PDOs at most.
        count: u8,
    },
    /// [`ProcessData::DirectExchange`]
    DirectExchange,
    /// [`ProcessData::DirectRead`]
    DirectRead,
}

impl ProcessKind {
    const fn command(self) -> (CommandCode, u8, PdoOperation) {
        use PdoOperation as Op;
        const DIRECT_EXCHANGE: Op = Op::WRITE.with(Op::READ).with(Op::VALID);
        match self {
            Self::Exchange { count } => (CommandCode::PdoDataFifo, count, Op::WRITE.with(Op::READ)),
            Self::Write { count } => (CommandCode::PdoDataFifo, count, Op::WRITE),
            Self::Read { count } => (CommandCode::PdoDataFifo, count, Op::READ),
            Self::DirectExchange => (CommandCode::PdoData, 0, DIRECT_EXCHANGE),
            Self::DirectRead => (CommandCode::PdoData, 0, Op::READ.with(Op::VALID)),
        }
    }

    /// RxPDOs that go into the FIFO.
    pub(super) const fn queued(self) -> u8 {
        match self {
            Self::Exchange { count } | Self::Write { count } => count,
            _ => 0,
        }
    }
}

/// What became of process data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessOutcome {
    /// The chip has answered. If they were to be read, [`Host::inputs`](super::Host::inputs) has the TxPDOs.
    Done {
        /// TxPDOs were read; `false` if none were asked for, or the TxFIFO was empty.
        read: bool,
    },
    /// The RxFIFO was full: the RxPDOs are lost.
    Full,
    /// The chip refused the command: wrong length, or process data are not exchanged yet.
    Refused,
    /// The RxPDOs were written; the answer and the TxPDOs in it are lost.
    AnswerLost,
    /// The RxPDOs were not written. Later ones have gone out since then, so that these are not sent again.
    NotWritten,
    /// No answer came in time, or the chip was reset: whether the RxPDOs were written is unknown.
    Unknown,
}

/// The end of an exchange of process data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessReport {
    /// Which ones: what [`Host::process`](super::Host::process) gave for them.
    pub sequence: u32,
    /// What became of them.
    pub outcome: ProcessOutcome,
}

/// Process data that were written and overtaken by the next ones before their answer was there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Overtaken {
    pub(super) sequence: u32,
    pub(super) index: u8,
    pub(super) code: CommandCode,
    pub(super) written: u8,
    pub(super) reads: bool,
    /// How many packets the chip had rejected when they were overtaken, as far as was seen.
    pub(super) rejections: u64,
    /// The chip's count of errors does not tell how many packets it rejected since then, or its error bits whether it
    /// took the RxPDOs.
    pub(super) unclear: bool,
}

/// Process data that were submitted. Their outputs stand in the packet that goes out next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outgoing {
    pub(super) sequence: u32,
    pub(super) code: CommandCode,
    pub(super) arguments: Arguments,
    /// RxPDOs, in the FIFO or past it.
    pub(super) written: u8,
    /// RxPDOs into the FIFO.
    pub(super) queued: u8,
    pub(super) reads: bool,
}

#[derive(Clone, Debug)]
pub(super) struct Process {
    sequence: u32,
    waiting: Option<Outgoing>,
    reports: [Option<ProcessReport>; REPORTS],
    /// The place of the oldest report.
    oldest: usize,
    /// How many there are.
    kept: usize,
    pub(super) overtaken: Option<Overtaken>,
}

impl Process {
    pub(super) const fn new() -> Self {
        Self { sequence: 0, waiting: None, reports: [None; REPORTS], oldest: 0, kept: 0, overtaken: None }
    }

    /// The sequence of the data that wait, if any do.
    pub(super) fn waiting(&self) -> Option<u32> {
        self.waiting.as_ref().map(|waiting| waiting.sequence)
    }

    /// Takes process data, whose `len` bytes of outputs `write` puts into the segment of the next packet.
    pub(super) fn submit(
        &mut self,
        kind: ProcessKind,
        len: usize,
        segment: &mut [u8],
        write: impl FnOnce(&mut [u8]),
    ) -> Result<u32, HostError> {
        let (code, parameter, operation) = kind.command();
        if let Some(sequence) = self.waiting() {
            return Err(HostError::ProcessBusy { sequence });
        }
        let most = segment.len();
        write(segment.get_mut(..len).ok_or(HostError::TooLong { code, found: len, most })?);
        self.sequence = self.sequence.wrapping_add(1);
        // A segment has 1408 bytes at most.
        let arguments = Arguments { parameter, info: [operation.0, 0, 0, 0], len: len as u16, ..Arguments::NONE };
        let queued = kind.queued();
        let written = if matches!(kind, ProcessKind::DirectExchange) { 1 } else { queued };
        let reads = operation.contains(PdoOperation::READ);
        self.waiting = Some(Outgoing { sequence: self.sequence, code, arguments, written, queued, reads });
        Ok(self.sequence)
    }

    /// Those that wait, which are on their way then, or are not sent at all.
    pub(super) fn sent(&mut self) -> Option<Outgoing> {
        self.waiting.take()
    }

    /// Adds a report; whether the oldest one had to go for it.
    pub(super) fn report(&mut self, report: ProcessReport) -> bool {
        let lost = self.kept == REPORTS;
        if lost {
            self.take_report();
        }
        self.reports[(self.oldest + self.kept) % REPORTS] = Some(report);
        self.kept += 1;
        lost
    }

    pub(super) fn take_report(&mut self) -> Option<ProcessReport> {
        let report = self.reports[self.oldest].take()?;
        self.oldest = (self.oldest + 1) % REPORTS;
        self.kept -= 1;
        Some(report)
    }
}
