//! Compares the requests to the driver and its reports with what reached the chip and the slaves.

use std::collections::BTreeMap;

use ecmsk::xf::CommandCode;
use ecmsk::xf::host::{HostCounters, HostError, ProcessOutcome, ProcessReport, Ticket};

use support::faulty_wire::Wire;

use super::network::{Log, Logged};

/// A command with a number that no other has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    WriteSdo(u32),
    ReadSdo(u32),
    WriteRegister(u16),
    ReadRegister(u8),
    WriteFlash(u32),
    CountSlaves,
    Restart,
}

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// With a result: it was run once.
    Done,
    /// It was run, and its result is lost.
    AnswerLost,
    /// It was not run.
    NotRun,
    /// It is not known.
    Unknown,
}

impl End {
    pub fn of(result: Result<(), HostError>) -> Self {
        match result {
            Ok(()) => Self::Done,
            // The reading command of a pair was refused: the other one ran.
            Err(HostError::AnswerLost { .. } | HostError::Refused { code: CommandCode::SdoGet }) => Self::AnswerLost,
            Err(HostError::Refused { .. } | HostError::NotSent { .. } | HostError::Failed { .. }) => Self::NotRun,
            Err(
                HostError::NoAnswer { .. }
                | HostError::StillBusy { .. }
                | HostError::ChipReset
                | HostError::Silent { .. }
                | HostError::StartTooLong { .. }
                | HostError::Int0Missing { .. }
                | HostError::DataSizeMismatch { .. },
            ) => Self::Unknown,
            Err(error) => panic!("no end of a command that was taken: {error}"),
        }
    }
}

/// Process data that the driver has taken.
#[derive(Clone, Copy, Debug)]
struct Targets {
    first: u32,
    /// RxPDOs, each with the next serial number.
    count: u32,
    /// TxPDOs that are read out of the FIFO, at most.
    reads: u32,
    /// How often the chip, or the driver, had restarted.
    life: u32,
    outcome: Option<ProcessOutcome>,
}

#[derive(Default)]
pub struct Books {
    pub open: Vec<(Ticket, What, u64)>,
    ended: Vec<(What, End)>,
    targets: BTreeMap<u32, Targets>,
    /// How often the chip, or the driver, has restarted, which clears its FIFOs.
    pub life: u32,
    /// The newest TxPDO that was read out of the FIFO, in this life.
    newest_read: Option<(u32, u32)>,
    /// TxPDOs that may have been read and lost since then.
    reads_lost: u32,
    may_overrun: bool,
    pub gaps: u64,
}

impl Books {
    /// `may_overrun`: the chip's RxFIFO is smaller than the driver's setting.
    pub fn new(may_overrun: bool) -> Self {
        Self { may_overrun, ..Self::default() }
    }

    pub fn submitted(&mut self, ticket: Ticket, what: What, now: u64) {
        self.open.push((ticket, what, now));
    }

    pub fn ended(&mut self, what: What, end: End) {
        self.ended.push((what, end));
    }

    pub fn process(&mut self, sequence: u32, first: u32, count: u32, reads: u32) {
        let targets = Targets { first, count, reads, life: self.life, outcome: None };
        assert!(self.targets.insert(sequence, targets).is_none(), "sequence numbers are used once");
    }

    /// Takes a report; `inputs` has the TxPDOs that were read, of `tx_bytes` each, and `newest` is the newest TxPDO.
    pub fn reported(&mut self, report: ProcessReport, inputs: &[u8], tx_bytes: usize, newest: u32) {
        let targets = self.targets.get_mut(&report.sequence).expect("a report is of something that was submitted");
        assert!(targets.outcome.is_none(), "two reports: {targets:?}, {report:?}");
        targets.outcome = Some(report.outcome);
        let most = targets.reads;
        if most == 0 {
            return;
        }
        match report.outcome {
            ProcessOutcome::Done { read: true } => self.read(inputs, tx_bytes, newest),
            ProcessOutcome::AnswerLost | ProcessOutcome::Unknown | ProcessOutcome::Full => self.reads_lost += most,
            _ => {}
        }
    }

    /// TxPDOs come once each, in their order, and those that are missing are reported or were too many for the FIFO.
    fn read(&mut self, inputs: &[u8], tx_bytes: usize, newest: u32) {
        assert!(!inputs.is_empty() && inputs.len().is_multiple_of(tx_bytes), "whole TxPDOs: {}", inputs.len());
        for pdo in inputs.chunks_exact(tx_bytes) {
            let serial = u32::from_le_bytes(*pdo.first_chunk().expect("4 bytes"));
            assert_eq!(pdo, super::network::pdo(serial, tx_bytes), "a TxPDO is of one piece");
            if let Some((before, life)) = self.newest_read {
                assert!(serial > before, "a TxPDO comes once: {serial} after {before}");
                let missing = serial - before - 1;
                let overflown = newest - before >= 62;
                assert!(
                    missing <= self.reads_lost || overflown || life != self.life,
                    "TxPDOs between {before} and {serial} are lost and not reported"
                );
                self.gaps += u64::from(missing > 0);
            }
            self.newest_read = Some((serial, self.life));
            self.reads_lost = 0;
        }
    }

    pub fn has_open_targets(&self) -> bool {
        self.targets.values().any(|targets| targets.outcome.is_none())
    }

    /// How many of these RxPDOs are surely in the FIFO, and how many may be.
    pub fn in_fifo(&self, from: u32) -> (u32, u32) {
        let since = || self.targets.values().filter(|targets| targets.first >= from);
        let sum = |is: fn(ProcessOutcome) -> bool| {
            since().filter(|targets| targets.outcome.is_some_and(is)).map(|targets| targets.count).sum::<u32>()
        };
        let sure = sum(|outcome| matches!(outcome, ProcessOutcome::Done { .. } | ProcessOutcome::AnswerLost));
        (sure, sure + sum(|outcome| matches!(outcome, ProcessOutcome::Unknown)))
    }

    /// All that must hold when everything has ended.
    pub fn close(&self, wire: &Wire<Logged>, counters: &HostCounters, begun_anew: u64) {
        let log = &wire.port.chip().network().log;
        self.commands_ran_once(wire, log);
        self.targets_arrived_once(log);
        self.counters_agree(counters, begun_anew);
    }

    fn commands_ran_once(&self, wire: &Wire<Logged>, log: &Log) {
        let times = |numbers: &mut dyn Iterator<Item = u32>| {
            let mut times = BTreeMap::<u32, usize>::new();
            numbers.for_each(|n| *times.entry(n).or_default() += 1);
            times
        };
        let writes = times(&mut log.writes.iter().copied());
        let reads = times(&mut log.reads.iter().copied());
        let registers = times(&mut wire.registers.iter().map(|n| u32::from(*n)));
        let flash = times(&mut wire.flash.iter().copied());
        for (what, end) in &self.ended {
            let (ran, n) = match *what {
                What::WriteSdo(n) => (&writes, n),
                What::ReadSdo(n) => (&reads, n),
                What::WriteRegister(n) => (&registers, n.into()),
                What::WriteFlash(n) => (&flash, n),
                What::ReadRegister(_) | What::CountSlaves | What::Restart => continue,
            };
            let times = ran.get(&n).copied().unwrap_or(0);
            let allowed = match end {
                End::Done => 1..=1,
                // An SDO that failed has lost its abort code.
                End::AnswerLost if matches!(what, What::WriteSdo(_) | What::ReadSdo(_)) => 0..=1,
                End::AnswerLost => 1..=1,
                End::NotRun => 0..=0,
                End::Unknown => 0..=1,
            };
            assert!(allowed.contains(&times), "{what:?} ended with {end:?} and ran {times} times");
        }
        for ran in [&writes, &reads, &registers, &flash] {
            assert!(ran.values().all(|times| *times == 1), "something ran twice: {ran:?}");
        }
        let rises = |numbers: &[u32]| numbers.windows(2).all(|pair| pair[0] < pair[1]);
        assert!(rises(&log.writes) && rises(&log.reads) && rises(&wire.flash), "commands run in their order");
        assert!(wire.registers.is_sorted(), "commands run in their order: {:?}", wire.registers);
    }

    /// RxPDOs arrive in their order, each once. One that was reported as written arrives unless a restart came before;
    /// then no later one arrives.
    fn targets_arrived_once(&self, log: &Log) {
        let arrived: Vec<u32> = log.cycles.iter().map(|(serial, _)| *serial).filter(|serial| *serial > 0).collect();
        assert!(arrived.is_sorted(), "RxPDOs arrive in their order: {arrived:?}");
        assert!(arrived.windows(2).all(|pair| pair[0] != pair[1]), "an RxPDO came back after others");
        let has_arrived = |serial: &u32| arrived.binary_search(serial).is_ok();
        let mut missing: Option<(u32, u32)> = None;
        for (sequence, targets) in &self.targets {
            let outcome = targets.outcome.unwrap_or_else(|| panic!("{sequence} has no report"));
            let serials = targets.first..targets.first + targets.count;
            let came = serials.clone().filter(has_arrived).count() as u32;
            let what = || format!("{came} of {targets:?} of life {} arrived", self.life);
            match outcome {
                ProcessOutcome::Done { .. } | ProcessOutcome::AnswerLost => {}
                ProcessOutcome::NotWritten | ProcessOutcome::Refused => assert!(came == 0, "{}", what()),
                ProcessOutcome::Full => {
                    assert!(self.may_overrun, "{}", what());
                    // There may have been room for only the first of several.
                    assert!(came < targets.count, "{}", what());
                    continue;
                }
                ProcessOutcome::Unknown => {}
            }
            if came > 0
                && let Some((serial, life)) = missing
            {
                assert!(life != targets.life, "{serial} was written and is lost: {}", what());
            }
            if matches!(outcome, ProcessOutcome::Done { .. } | ProcessOutcome::AnswerLost) && came < targets.count {
                assert!(targets.life != self.life, "lost: {}", what());
                missing = Some((targets.first + came, targets.life));
            }
        }
    }

    fn counters_agree(&self, counters: &HostCounters, begun_anew: u64) {
        let sum = |is: fn(ProcessOutcome) -> bool| {
            let targets = self.targets.values().filter(|targets| targets.outcome.is_some_and(is));
            targets.map(|targets| u64::from(targets.count)).sum::<u64>()
        };
        let written = sum(|outcome| matches!(outcome, ProcessOutcome::Done { .. } | ProcessOutcome::AnswerLost));
        assert_eq!(counters.rx_written, written, "{counters:?}");
        assert_eq!(counters.rx_full, sum(|outcome| outcome == ProcessOutcome::Full), "{counters:?}");
        assert_eq!(counters.rx_unknown, sum(|outcome| outcome == ProcessOutcome::Unknown), "{counters:?}");
        // Beside overtaken ones there are those that waited when the driver restarted.
        let not_written = sum(|outcome| outcome == ProcessOutcome::NotWritten);
        assert!(counters.rx_dropped <= not_written, "{counters:?}");
        assert!(not_written - counters.rx_dropped <= MOST_AT_ONCE * begun_anew, "{counters:?}");
        assert_eq!(counters.reports_overwritten, 0);
        assert!(counters.answers + counters.damaged + counters.not_ready <= counters.exchanges, "{counters:?}");
    }
}

/// RxPDOs that are submitted together.
pub const MOST_AT_ONCE: u64 = 3;
