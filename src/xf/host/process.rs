//! Process data that are waiting for their exchange, and the outcome of those that were sent.

use super::error::HostError;
use crate::xf::request::{Arguments, PdoOperation};
use crate::xf::{CommandCode, Errors};

/// Number of reports that are kept until the program takes them.
const REPORTS: usize = 4;

/// The error bits that the chip sets when it rejects a write.
pub(super) const NOT_TAKEN: Errors = Errors::FIFO.with(Errors::COMMAND);

/// Process data for one exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessRequest<'d> {
    /// PDO_DATA_FIFO_OP: RxPDOs into the FIFO, and the same number of TxPDOs out of the FIFO.
    Exchange {
        /// Number of PDOs to write, and maximum number to read.
        count: u8,
        /// The RxPDOs, one after the other.
        outputs: &'d [u8],
    },
    /// PDO_DATA_FIFO_OP: RxPDOs into the FIFO, without reading TxPDOs.
    Write {
        /// Number of PDOs to write.
        count: u8,
        /// The RxPDOs, one after the other.
        outputs: &'d [u8],
    },
    /// PDO_DATA_FIFO_OP: TxPDOs out of the FIFO, without writing RxPDOs.
    Read {
        /// Maximum number of PDOs to read.
        count: u8,
    },
    /// PDO_DATA_OP: one RxPDO and one TxPDO directly, without the FIFO.
    DirectExchange {
        /// The RxPDO with the outputs of all slaves.
        outputs: &'d [u8],
    },
    /// PDO_DATA_OP: one TxPDO directly, without the FIFO, for example to learn positions.
    DirectRead,
}

impl<'d> ProcessRequest<'d> {
    /// Splits the process data into the kind of their exchange and the RxPDOs.
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

/// The kind of an exchange of process data, without the RxPDOs themselves, for
/// [`Host::process_in_place`](super::Host::process_in_place).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessKind {
    /// Like [`ProcessRequest::Exchange`].
    Exchange {
        /// Number of PDOs to write, and maximum number to read.
        count: u8,
    },
    /// Like [`ProcessRequest::Write`].
    Write {
        /// Number of PDOs to write.
        count: u8,
    },
    /// Like [`ProcessRequest::Read`].
    Read {
        /// Maximum number of PDOs to read.
        count: u8,
    },
    /// Like [`ProcessRequest::DirectExchange`].
    DirectExchange,
    /// Like [`ProcessRequest::DirectRead`].
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

    /// Number of RxPDOs that go into the FIFO.
    pub(super) const fn queued(self) -> u8 {
        match self {
            Self::Exchange { count } | Self::Write { count } => count,
            _ => 0,
        }
    }
}

/// The outcome of an exchange of process data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessOutcome {
    /// The chip has answered. If the exchange read TxPDOs, [`Host::inputs`](super::Host::inputs) has them.
    Done {
        /// Whether TxPDOs were read; `false` if none were requested, or the TxFIFO was empty.
        read: bool,
    },
    /// The RxFIFO was full: the RxPDOs are lost.
    Full,
    /// The chip refused the command: wrong length, or process data are not exchanged yet.
    Refused,
    /// The RxPDOs were written, but the answer with the TxPDOs is lost.
    AnswerLost,
    /// The RxPDOs were not written. They are not retried, since later ones have already been sent.
    NotWritten,
    /// No answer came in time, or the chip was reset: it is unknown whether the RxPDOs were written.
    Unknown,
}

/// The report on an exchange of process data that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessReport {
    /// The sequence number that [`Host::process`](super::Host::process) returned.
    pub sequence: u32,
    /// Whether the chip took the RxPDOs and whether TxPDOs were read.
    pub outcome: ProcessOutcome,
}

/// Process data whose answer had not come yet when the next process data were sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Overtaken {
    pub(super) sequence: u32,
    pub(super) index: u8,
    pub(super) code: CommandCode,
    pub(super) written: u8,
    pub(super) reads: bool,
    /// The number of packets known to be rejected by the chip when the next process data were sent.
    pub(super) rejections: u64,
    /// Whether the driver can no longer find out if the chip took the RxPDOs: the chip's count of rejected packets has
    /// become unclear, or a later packet clears the error bits that would show it. The outcome is then
    /// [`ProcessOutcome::Unknown`].
    pub(super) unclear: bool,
}

/// Submitted process data. Their outputs are in the buffer of the next packet.
#[derive(Clone, Copy, Debug)]
pub(super) struct OutgoingProcessData {
    pub(super) sequence: u32,
    pub(super) code: CommandCode,
    pub(super) arguments: Arguments,
    /// Number of RxPDOs that are written, into the FIFO or directly.
    pub(super) written: u8,
    /// Number of those RxPDOs that go into the FIFO.
    pub(super) queued: u8,
    pub(super) reads: bool,
}

#[derive(Clone, Debug)]
pub(super) struct Process {
    sequence: u32,
    waiting: Option<OutgoingProcessData>,
    reports: [Option<ProcessReport>; REPORTS],
    /// The index in `reports` of the oldest report that the program has not taken yet.
    oldest: usize,
    /// Number of reports that the program has not taken yet.
    kept: usize,
    pub(super) overtaken: Option<Overtaken>,
}

impl Process {
    pub(super) const fn new() -> Self {
        Self { sequence: 0, waiting: None, reports: [None; REPORTS], oldest: 0, kept: 0, overtaken: None }
    }

    /// The sequence number of the process data that wait to be sent; `None` if none do.
    pub(super) fn waiting(&self) -> Option<u32> {
        self.waiting.as_ref().map(|waiting| waiting.sequence)
    }

    /// Submits process data; `write` puts their `len` bytes of outputs into the data segment of the next packet.
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
        // The cast is safe: a data segment has at most 1408 bytes.
        let arguments = Arguments { parameter, info: [operation.0, 0, 0, 0], len: len as u16, ..Arguments::NONE };
        let queued = kind.queued();
        let written = if matches!(kind, ProcessKind::DirectExchange) { 1 } else { queued };
        let reads = operation.contains(PdoOperation::READ);
        self.waiting = Some(OutgoingProcessData { sequence: self.sequence, code, arguments, written, queued, reads });
        Ok(self.sequence)
    }

    /// Takes the waiting process data. The caller sends them now, or reports that they were refused.
    pub(super) fn sent(&mut self) -> Option<OutgoingProcessData> {
        self.waiting.take()
    }

    /// Adds a report; returns whether the oldest one was overwritten.
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
