//! Which slaves are lost: found with the answer of each cycle, by the AL states that the master has read and by inputs that
//! have become stale.

use super::{NicBus, NicWires};
use crate::ethercat::registers::RequestedState;
use crate::ethercat::{AlState, SlaveSet};

impl<W: NicWires> NicBus<W> {
    /// Whether a slave that is not known as lost is in a lower AL state than commanded: it still increments the working
    /// counter, but ignores outputs. `states`: the AL status of all slaves, combined by OR.
    pub(super) fn has_fallen_slave(&self, states: u16) -> bool {
        let known = |slave| {
            if self.lost.contains(slave) {
                self.master.lock().status(slave).map_or(0, |status| status.status.0)
            } else {
                RequestedState::State(self.station(slave).commanded).code().into()
            }
        };
        self.job.is_none() && states & !self.all().iter().map(known).fold(0, |all, bits| all | bits) != 0
    }

    /// Updates the set of lost slaves by the AL states that the master has read.
    pub(super) fn update_lost(&mut self) {
        let Self { master, stations, lost, lost_from, ages, missed, found, .. } = self;
        let had_lost = !lost.is_empty();
        master.lock().look_at_statuses(|slave, status| {
            if slave > *found {
                return;
            }
            let n = usize::from(slave) - 1;
            let state = Some(status).filter(|status| status.is_present).and_then(|status| status.state());
            let is_missing = state.is_none_or(|state| state < stations[n].commanded);
            if is_missing && !lost.contains(slave) {
                lost.insert(slave);
                lost_from[n] = missed.name(had_lost);
            } else if !is_missing && stations[n].commanded < AlState::SafeOp {
                lost.remove(slave);
                ages.forget(slave);
                lost_from[n] = None;
            }
        });
    }

    /// Marks slaves whose inputs have become stale as lost. Outputs since then count as not executed, because it is not
    /// known what these slaves do.
    pub(super) fn lose_stale(&mut self, stale: SlaveSet) {
        let had_lost = !self.lost.is_empty();
        for slave in stale.difference(self.lost).iter() {
            self.lost.insert(slave);
            self.lost_from[usize::from(slave) - 1] = self.missed.name(had_lost);
        }
    }
}
