//! The AL state machine of a device (ETG.1000.6 6.4): the allowed changes of state, and the watchdog for its outputs.

use super::AlStatus;
use crate::ethercat::{AlState, Ns};

/// \[OURS] The time without outputs after which a device leaves OP, ns. It is the usual setting of the sync manager
/// watchdog.
pub const WATCHDOG_NS: Ns = 100_000_000;

/// The AL state machine of one device.
#[derive(Clone, Debug, Default)]
pub struct ApplicationLayer {
    state: AlState,
    /// AL status code: the reason of the last refused state change or of the last fall to a lower state; 0 after a
    /// successful change.
    status: u16,
    /// Whether outputs have come since the last step.
    outputs_came: bool,
    /// The time since the last outputs, ns.
    without_outputs_ns: Ns,
}

impl ApplicationLayer {
    /// The AL state.
    pub const fn state(&self) -> AlState {
        self.state
    }

    /// The AL status code of the last refused state change, or of the last fall to a lower state if that came later.
    pub const fn status(&self) -> AlStatus {
        AlStatus(self.status)
    }

    /// Falls back to `target` if that is lower than the present state, and sets the AL status code with the reason.
    pub fn fall(&mut self, target: AlState, AlStatus(status): AlStatus) {
        self.state = self.state.min(target);
        self.status = status;
    }

    /// Changes the state: to the next higher one, to any lower one, or to the present one. `ready`: whether the device
    /// allows the change to the next higher state.
    ///
    /// # Errors
    /// [`AlStatus::INVALID_CHANGE`] if the change would skip a state on the way up, or the error in `ready`.
    pub fn enter(&mut self, target: AlState, ready: Result<(), AlStatus>) -> Result<(), AlStatus> {
        use AlState::*;
        let allowed = match (self.state, target) {
            (from, to) if to <= from => Ok(()),
            (Init, PreOp) | (PreOp, SafeOp) | (SafeOp, Op) => ready,
            _ => Err(AlStatus::INVALID_CHANGE),
        };
        self.status = allowed.map_or_else(|AlStatus(code)| code, |()| 0);
        allowed?;
        self.state = target;
        self.outputs_came = false;
        self.without_outputs_ns = 0;
        Ok(())
    }

    /// Restarts the watchdog, because outputs have come.
    pub const fn note_outputs(&mut self) {
        self.outputs_came = true;
    }

    /// Advances the watchdog by `dt_ns`. Returns true if the watchdog has just expired and the device has gone from OP
    /// to SafeOP.
    ///
    /// The first step after outputs does not count, whatever its length. Otherwise a cycle that is longer than the
    /// watchdog time would always expire the watchdog, although outputs come in every cycle.
    pub fn step(&mut self, dt_ns: Ns) -> bool {
        if self.state != AlState::Op || std::mem::take(&mut self.outputs_came) {
            self.without_outputs_ns = 0;
            return false;
        }
        self.without_outputs_ns += dt_ns;
        let expired = self.without_outputs_ns >= WATCHDOG_NS;
        if expired {
            self.fall(AlState::SafeOp, AlStatus::WATCHDOG);
        }
        expired
    }
}
