//! The handle with which scripts and tests access a running simulated network from any thread: its cable, and the true
//! positions of its shafts.

use std::ops::Deref;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::AXES_MAX;
use super::cable::Cable;
use crate::ethercat::{MAX_SLAVES, Ns};

/// The true positions of all shafts, independent of what their slaves report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shafts {
    /// The end of the cycle to which the positions belong, ns in the network's time.
    pub at: Ns,
    /// Positions, counts: `positions[n - 1]` has the axes of slave n; `None` for an axis that does not exist.
    pub positions: [[Option<i64>; AXES_MAX]; MAX_SLAVES],
}

/// A handle to a simulated network; clones refer to the same network. It dereferences to its [`Cable`], which injects
/// faults.
#[derive(Clone)]
pub struct SimHandle {
    cable: Cable,
    shafts: Arc<Mutex<Shafts>>,
}

impl Default for SimHandle {
    fn default() -> Self {
        let positions = [[None; AXES_MAX]; MAX_SLAVES];
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
    /// The cable of the network, for injecting faults.
    pub const fn cable(&self) -> &Cable {
        &self.cable
    }

    /// The positions of all shafts at the end of the newest cycle.
    pub fn shafts(&self) -> Shafts {
        self.lock().clone()
    }

    /// The position of one shaft at the end of the newest cycle, counts; `None` if there is no such axis.
    pub fn shaft(&self, slave: u8, axis: usize) -> Option<i64> {
        let place = usize::from(slave).checked_sub(1)?;
        *self.lock().positions.get(place)?.get(axis)?
    }

    /// Stores the positions at the end of a cycle. If another thread is reading positions at this moment, the new ones
    /// are dropped, because the cycle must not wait.
    pub(crate) fn publish(&self, at: Ns, positions: impl Iterator<Item = [Option<i64>; AXES_MAX]>) {
        let Ok(mut shafts) = self.shafts.try_lock() else { return };
        shafts.at = at;
        for (shown, position) in shafts.positions.iter_mut().zip(positions) {
            *shown = position;
        }
    }

    /// Locks the positions. Poisoning is ignored, because the plain data in the mutex are still valid after a panic.
    fn lock(&self) -> MutexGuard<'_, Shafts> {
        self.shafts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
