//! The handle by which scripts and tests reach a simulated bus while it runs, from any thread: its cable, and the true
//! positions of its shafts.

use std::ops::Deref;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::fieldbus::cable::Cable;
use crate::fieldbus::{MAX_AXES, MAX_SLAVES, Ns};

/// The true positions of all shafts, whatever their slaves report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shafts {
    /// The end of the cycle in which they were there, board time.
    pub at: Ns,
    /// Slave n is `positions[n - 1]`, one entry for each axis, counts; `None`: no such axis.
    pub positions: [[Option<i64>; MAX_AXES]; MAX_SLAVES],
}

/// A handle on a [`super::SimBus`]; clones are handles on the same bus. It has the functions of the [`Cable`] of the bus,
/// by which things go wrong.
#[derive(Clone)]
pub struct SimHandle {
    cable: Cable,
    shafts: Arc<Mutex<Shafts>>,
}

impl Default for SimHandle {
    fn default() -> Self {
        let positions = [[None; MAX_AXES]; MAX_SLAVES];
        Self { cable: Cable::default(), shafts: Arc::new(Mutex::new(Shafts { at: 0, positions })) }
    }
}

impl Deref for SimHandle {
    type Target = Cable;

    fn deref(&self) -> &Cable {
        &self.cable
    }
}

impl SimHandle {
    /// The cable of the bus.
    pub const fn cable(&self) -> &Cable {
        &self.cable
    }

    /// The positions of all shafts at the end of the newest cycle.
    pub fn shafts(&self) -> Shafts {
        self.lock().clone()
    }

    /// The position of one shaft at the end of the newest cycle, counts; `None`: there is no such axis.
    pub fn shaft(&self, slave: u8, axis: usize) -> Option<i64> {
        let place = usize::from(slave).checked_sub(1)?;
        *self.lock().positions.get(place)?.get(axis)?
    }

    /// Keeps the positions at the end of a cycle, unless a thread is reading those of the cycle before at this moment.
    pub(super) fn publish(&self, at: Ns, positions: impl Iterator<Item = [Option<i64>; MAX_AXES]>) {
        let Ok(mut shafts) = self.shafts.try_lock() else { return };
        shafts.at = at;
        for (shown, position) in shafts.positions.iter_mut().zip(positions) {
            *shown = position;
        }
    }

    /// A thread that has panicked leaves plain data behind, which is still valid.
    fn lock(&self) -> MutexGuard<'_, Shafts> {
        self.shafts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
