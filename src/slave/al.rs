//! The AL state of a device (ETG.1000.6 6.4): which changes it takes part in, and the watchdog of its outputs.

use super::AlStatus;
use crate::ethercat::{AlState, Ns};

/// \[OURS] Outputs that stay away for so long end OP, as a sync manager's watchdog does with its usual setting.
pub const WATCHDOG_NS: Ns = 100_000_000;

/// AL state machine of one device.
#[derive(Clone, Debug, Default)]
pub struct ApplicationLayer {
    state: AlState,
    /// Outputs came since the last step.
    fed: bool,
    /// For how long none have come.
    starved_ns: Ns,
}

impl ApplicationLayer {
    /// The state.
    pub const fn state(&self) -> AlState {
        self.state
    }

    /// Goes to a state: to the next one up, to any one down, or to the one it is in. `ready` is what the device says
    /// of its process data before it enters SafeOP.
    ///
    /// # Errors
    /// [`AlStatus::INVALID_CHANGE`] if a state is left out, or what `ready` says.
    pub fn enter(&mut self, target: AlState, ready: Result<(), AlStatus>) -> Result<(), AlStatus> {
        use AlState::*;
        match (self.state, target) {
            (from, to) if to <= from => {}
            (Init, PreOp) | (SafeOp, Op) => {}
            (PreOp, SafeOp) => ready?,
            _ => return Err(AlStatus::INVALID_CHANGE),
        }
        self.state = target;
        self.fed = false;
        self.starved_ns = 0;
        Ok(())
    }

    /// Outputs have come.
    pub const fn feed(&mut self) {
        self.fed = true;
    }

    /// `dt_ns` pass. True: the watchdog has just ended OP; the device is in SafeOP now.
    ///
    /// The time right after outputs is not counted, however long: a cycle may be longer than the watchdog.
    pub fn step(&mut self, dt_ns: Ns) -> bool {
        if self.state != AlState::Op || std::mem::take(&mut self.fed) {
            self.starved_ns = 0;
            return false;
        }
        self.starved_ns += dt_ns;
        let expired = self.starved_ns >= WATCHDOG_NS;
        if expired {
            self.state = AlState::SafeOp;
        }
        expired
    }
}
