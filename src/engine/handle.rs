//! What scripts and tests do to a board itself while it runs, from any thread. What happens on its network is the bus's
//! to say.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use super::Engine;

/// Nobody has set the inputs.
const UNTOUCHED: u8 = u8::MAX;

struct Shared {
    reports_suppressed: AtomicBool,
    fifo_held: AtomicBool,
    local_inputs: AtomicU8,
}

/// A handle on a [`super::Board`]; clones are handles on the same board. What is said here holds from its next cycle on.
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
    /// The board makes no reports, while everything else goes on; or it makes them again.
    pub fn suppress_reports(&self, reports_suppressed: bool) {
        self.0.reports_suppressed.store(reports_suppressed, Ordering::Relaxed);
    }

    /// The board takes nothing out of its FIFO, so that it fills and full counts rise; or it goes on.
    pub fn hold_fifo(&self, held: bool) {
        self.0.fifo_held.store(held, Ordering::Relaxed);
    }

    /// Sets the chip's six inputs, bit k is input k (SK-8).
    pub fn set_local_inputs(&self, bits: u8) {
        self.0.local_inputs.store(bits & 0x3F, Ordering::Relaxed);
    }

    /// A cycle begins.
    pub(super) fn apply(&self, engine: &mut Engine) {
        engine.suppress_reports(self.0.reports_suppressed.load(Ordering::Relaxed));
        engine.hold_fifo(self.0.fifo_held.load(Ordering::Relaxed));
        let inputs = self.0.local_inputs.load(Ordering::Relaxed);
        if inputs != UNTOUCHED {
            engine.set_local_inputs(inputs);
        }
    }
}
