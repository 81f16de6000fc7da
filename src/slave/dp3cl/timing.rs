//! The cycle timing that the monitors U3 show: when outputs and SYNC0 pulses came, and their intervals. \[OURS] Times are
//! in microseconds and measured from the change to SafeOP on; a point in time counts from power-on, and its monitor shows
//! the lower 16 bits.

use crate::ethercat::Ns;

/// The unit of U3, ns: one microsecond \[OURS].
const US: Ns = 1000;

/// The last, the maximum and the minimum of repeatedly measured intervals, ns.
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

    /// The last, maximum and minimum interval as the monitors show them, us; 0 before the first interval.
    pub(super) fn shown(&self) -> [u16; 3] {
        [self.last, self.most, self.least.unwrap_or(0)].map(|ns| (ns / US) as u16)
    }
}

/// The times of a cyclic event: its last occurrence and its periods.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cyclic {
    last: Option<Ns>,
    periods: Spans,
}

impl Cyclic {
    /// Records an occurrence at time `at`, ns since power-on.
    fn note(&mut self, at: Ns) {
        if let Some(last) = self.last.replace(at) {
            self.periods.note(at.saturating_sub(last));
        }
    }

    /// The periods between the occurrences.
    pub(super) const fn periods(&self) -> &Spans {
        &self.periods
    }

    /// The time of the last occurrence, us since power-on; 0 before the first one.
    pub(super) fn time(&self) -> u16 {
        (self.last.unwrap_or(0) / US) as u16
    }
}

/// The cycle timing of the drive.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Timing {
    /// When outputs arrived (at the process data interface, PDI), and the periods between them.
    pub(super) pdi: Cyclic,
    /// When SYNC0 pulses occurred, and the periods between them.
    pub(super) sync0: Cyclic,
    /// The interval from the arrival of outputs to the next SYNC0 pulse.
    pub(super) pdi_to_sync0: Spans,
    /// The time of outputs that no SYNC0 pulse has followed yet, ns since power-on. `None`: a pulse has followed.
    waiting: Option<Ns>,
}

impl Timing {
    /// Records the arrival of outputs at time `at`, ns since power-on.
    pub(super) fn note_outputs(&mut self, at: Ns) {
        self.pdi.note(at);
        self.waiting = Some(at);
    }

    /// Records a SYNC0 pulse at time `at`, ns since power-on.
    pub(super) fn note_sync0(&mut self, at: Ns) {
        self.sync0.note(at);
        if let Some(outputs) = self.waiting.take() {
            self.pdi_to_sync0.note(at.saturating_sub(outputs));
        }
    }
}
