//! The history of a schedule: cycles on the wire, outputs passed to the bus, the newest answer that the engine has
//! taken.

use std::collections::VecDeque;
use std::sync::Arc;

use ecmsk::fieldbus::{MAX_AXES, Ns, SlaveOut, SlaveSet};

use super::log::{Cycle, Event, SLAVES};
use crate::machine::MARKER;

/// Cycles that are kept: more than the bus has ahead, plus the delay of answers, plus the unnoticed silence of a slave.
const REMEMBERED: usize = 600;

/// Outputs that the engine has passed to the bus.
pub struct Pushed {
    pub id: u64,
    pub outputs: Box<[SlaveOut; SLAVES]>,
    /// Cycles that had passed by then.
    pub at: usize,
    /// The mark of the FIFO entry that they carry, if they carry one.
    pub mark: Option<u16>,
    /// The cycle that sent them.
    pub sent: Option<usize>,
}

/// The trace. Cycles are numbered from 0.
#[derive(Default)]
pub struct Trace {
    cycles: VecDeque<Arc<Cycle>>,
    /// Number of the oldest stored cycle.
    oldest: usize,
    pushed: VecDeque<Pushed>,
    /// The cycle whose answer the engine has taken last.
    pub answered: Option<usize>,
    /// Cycles that had passed when slaves were brought to OP last.
    pub op: usize,
    /// 0x6060 of each axis, as the board knows it.
    modes: [[u8; MAX_AXES]; SLAVES],
    /// Slaves that got another mode since the newest answer.
    pub new_modes: SlaveSet,
    /// A clear has ended since the newest answer.
    pub was_cleared: bool,
}

impl Trace {
    /// Processes an event; returns the number of outputs that were sent for the first time.
    pub fn apply(&mut self, event: &Event) -> Option<u64> {
        match event {
            Event::Passed(cycle) => return self.pass(cycle),
            Event::Pushed { id, outputs } => self.push(*id, outputs),
            Event::Answered { at, .. } => {
                self.answered = Some(self.cycle_at(*at).expect("an answer of a cycle that has passed"));
                (self.new_modes, self.was_cleared) = (SlaveSet::EMPTY, false);
            }
            Event::Cleared { newest_sent } => {
                while self.pushed.back().is_some_and(|pushed| Some(pushed.id) > *newest_sent) {
                    let gone = self.pushed.pop_back().expect("it was there");
                    assert!(gone.sent.is_none(), "outputs {} were sent, and a clear says that they were not", gone.id);
                }
                self.was_cleared = true;
            }
            Event::Mode { slave, axis, mode } => {
                self.modes[usize::from(*slave) - 1][*axis] = *mode;
                self.new_modes.insert(*slave);
            }
            Event::Op => self.op = self.passed(),
        }
        None
    }

    fn pass(&mut self, cycle: &Arc<Cycle>) -> Option<u64> {
        let n = self.passed();
        self.cycles.push_back(Arc::clone(cycle));
        if self.cycles.len() > REMEMBERED {
            self.cycles.pop_front();
            self.oldest += 1;
        }
        while self.pushed.len() > 1 && self.pushed[0].sent.is_some_and(|sent| sent < self.oldest) {
            self.pushed.pop_front();
        }
        let (id, outputs) = cycle.outputs.as_ref()?;
        let pushed = self.pushed.iter_mut().rfind(|pushed| pushed.id == *id && pushed.sent.is_none())?;
        // Repeated outputs are not new, and before the first ones of an OP the bus sends none of the engine's.
        if *pushed.outputs != *outputs {
            return None;
        }
        pushed.sent = Some(n);
        Some(*id)
    }

    fn push(&mut self, id: u64, outputs: &[SlaveOut; SLAVES]) {
        let (mark, before) = (mark(outputs), self.pushed.back().map_or(0, |pushed| mark(&pushed.outputs)));
        assert!(self.pushed.back().is_none_or(|pushed| pushed.id < id), "ids rise");
        self.pushed.push_back(Pushed {
            id,
            outputs: Box::new(*outputs),
            at: self.passed(),
            mark: (mark != 0 && mark != before).then_some(mark),
            sent: None,
        });
    }

    /// Cycles that have passed.
    pub fn passed(&self) -> usize {
        self.oldest + self.cycles.len()
    }

    pub fn cycle(&self, n: usize) -> &Cycle {
        &self.cycles[n - self.oldest]
    }

    /// Number of the oldest stored cycle.
    pub fn oldest(&self) -> usize {
        self.oldest
    }

    pub fn newest(&self) -> &Cycle {
        self.cycles.back().expect("a cycle has passed")
    }

    /// The cycle of which the engine has the answer.
    pub fn answer(&self) -> Option<&Cycle> {
        self.answered.map(|n| self.cycle(n))
    }

    pub fn cycle_at(&self, at: Ns) -> Option<usize> {
        self.cycles.iter().rposition(|cycle| cycle.at == at).map(|n| n + self.oldest)
    }

    /// Outputs that were passed to the bus and not cleared since.
    pub fn outputs(&self, id: u64) -> Option<&Pushed> {
        self.pushed.iter().rfind(|pushed| pushed.id == id)
    }

    /// The newest outputs passed to the bus, and those before them.
    pub fn newest_outputs(&self) -> (&Pushed, Option<&Pushed>) {
        let mut newest = self.pushed.iter().rev();
        (newest.next().expect("some were handed over"), newest.next())
    }

    /// Whether all outputs were sent and answered.
    pub fn is_at_rest(&self) -> bool {
        let newest = self.pushed.iter().filter_map(|pushed| pushed.sent).max();
        self.pushed.iter().all(|pushed| pushed.sent.is_some()) && self.answered >= newest
    }

    pub fn mode(&self, slave: usize, axis: usize) -> u8 {
        self.modes[slave - 1][axis]
    }
}

/// The mark in outputs; 0: none since OP began.
pub fn mark(outputs: &[SlaveOut; SLAVES]) -> u16 {
    outputs[MARKER - 1][0].outputs
}
