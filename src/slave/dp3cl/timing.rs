//! What U3 shows of the cycle: when outputs and pulses of SYNC0 came, and how far apart they were. \[OURS] All of it in microseconds
//! and as of the change to SafeOP; a time is that since power-on, of which the monitors show the lower 16 bits.

use crate::ethercat::Ns;

/// A microsecond, the unit of U3 \[OURS].
const US: Ns = 1000;

/// The last, the greatest and the least of some spans of time, ns.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Spans {
    last: Ns,
    most: Ns,
    least: Option<Ns>,
}

impl Spans {
    fn note(&mut self, ns: Ns) {
        self.last = ns;
        self.most = self.most.max(ns);
        self.least = Some(self.least.map_or(ns, |least| least.min(ns)));
    }

    /// The last, the greatest and the least one as monitors show them, us; 0 before there was one.
    pub(super) fn shown(&self) -> [u16; 3] {
        [self.last, self.most, self.least.unwrap_or(0)].map(|ns| (ns / US) as u16)
    }
}

/// Things that come each cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cyclic {
    last: Option<Ns>,
    periods: Spans,
}

impl Cyclic {
    /// One came, so long after power-on.
    fn note(&mut self, at: Ns) {
        if let Some(last) = self.last.replace(at) {
            self.periods.note(at.saturating_sub(last));
        }
    }

    /// The spans between them.
    pub(super) const fn periods(&self) -> &Spans {
        &self.periods
    }

    /// When the last one came, us; 0 before.
    pub(super) fn time(&self) -> u16 {
        (self.last.unwrap_or(0) / US) as u16
    }
}

/// The timing of the cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Timing {
    /// Outputs.
    pub(super) pdi: Cyclic,
    /// Pulses of SYNC0.
    pub(super) sync0: Cyclic,
    /// From outputs to the pulse of SYNC0 after them.
    pub(super) pdi_to_sync0: Spans,
    /// When outputs came that no pulse has followed yet.
    waiting: Option<Ns>,
}

impl Timing {
    /// Outputs came, so long after power-on.
    pub(super) fn note_outputs(&mut self, at: Ns) {
        self.pdi.note(at);
        self.waiting = Some(at);
    }

    /// A pulse of SYNC0 came, so long after power-on.
    pub(super) fn note_sync0(&mut self, at: Ns) {
        self.sync0.note(at);
        if let Some(outputs) = self.waiting.take() {
            self.pdi_to_sync0.note(at.saturating_sub(outputs));
        }
    }
}
