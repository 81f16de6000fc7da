//! A handle by which scripts and tests cause faults of a running board, from any thread. Faults of its network are
//! caused by [`Cable`](crate::slave::cable::Cable).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use super::Engine;

/// The value of `local_inputs` before the first call of [`BoardHandle::set_local_inputs`]; six input bits cannot have
/// it. While the field has this value, the board uses the inputs that the bus reports.
const UNTOUCHED: u8 = u8::MAX;

struct Shared {
    reports_suppressed: AtomicBool,
    fifo_held: AtomicBool,
    local_inputs: AtomicU8,
}

/// A handle to a [`super::Board`]. Clones refer to the same board. Calls take effect in its next cycle.
#[derive(Clone)]
pub struct BoardHandle(Arc<Shared>);

impl Default for BoardHandle {
    fn default() -> Self {
        Self(Arc::new(Shared {
            reports_suppressed: AtomicBool::new(false),
            fifo_held: AtomicBool::new(false),
            local_inputs: AtomicU8::new(UNTOUCHED),
        }))
    }
}

impl BoardHandle {
    /// With `true` the board sends no reports from now on, with `false` it sends them again. It executes commands and
    /// runs its network all the same.
    pub fn suppress_reports(&self, suppressed: bool) {
        self.0.reports_suppressed.store(suppressed, Ordering::Relaxed);
    }

    /// With `true` the board takes no entries out of its FIFO from now on, with `false` it takes them again. While it
    /// takes none, the FIFO fills up and the full count rises.
    pub fn hold_fifo(&self, held: bool) {
        self.0.fifo_held.store(held, Ordering::Relaxed);
    }

    /// Sets the six local inputs of the chip (LIO_RD): bit k is input k (SK-8).
    pub fn set_local_inputs(&self, bits: u8) {
        self.0.local_inputs.store(bits & 0x3F, Ordering::Relaxed);
    }

    /// Called at the beginning of a cycle: gives the engine the values that the calls of this handle have set last.
    pub(super) fn apply(&self, engine: &mut Engine) {
        engine.suppress_reports(self.0.reports_suppressed.load(Ordering::Relaxed));
        engine.hold_fifo(self.0.fifo_held.load(Ordering::Relaxed));
        let inputs = self.0.local_inputs.load(Ordering::Relaxed);
        if inputs != UNTOUCHED {
            engine.set_local_inputs(inputs);
        }
    }
}
