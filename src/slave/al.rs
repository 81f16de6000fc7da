//! The AL state machine of a device (ETG.1000.6 6.4): which changes of state it allows, and the watchdog of its outputs.

use super::AlStatus;
use crate::ethercat::{AlState, Ns};

/// \[OURS] A device that gets no outputs for this time leaves OP. It is the usual setting of the sync manager watchdog.
pub const WATCHDOG_NS: Ns = 100_000_000;

/// The AL state machine of one device.
#[derive(Clone, Debug, Default)]
pub struct ApplicationLayer {
    state: AlState,
    /// The AL status code of the last change that was refused, or of the watchdog; 0 after a change that was made.
    status: u16,
    /// Outputs have come since the last step.
    outputs_came: bool,
    /// For how long no outputs have come.
    without_outputs_ns: Ns,
}

impl ApplicationLayer {
    /// The AL state.
    pub const fn state(&self) -> AlState {
        self.state
    }

    /// The AL status code of the last change that was refused, or of the watchdog if that has ended OP since.
    pub const fn status(&self) -> AlStatus {
        AlStatus(self.status)
    }

    /// Falls back to a lower state, or stays, for the reason that the AL status code says.
    pub fn fall(&mut self, target: AlState, AlStatus(status): AlStatus) {
        self.state = self.state.min(target);
        self.status = status;
    }

    /// Goes to a state: to the next higher one, to any lower one, or to the present one. `ready` says whether the device
    /// allows the step up.
    ///
    /// # Errors
    /// [`AlStatus::INVALID_CHANGE`] if a state is left out on the way up, or the error in `ready`.
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

    /// Outputs have come: the watchdog starts again.
    pub const fn note_outputs(&mut self) {
        self.outputs_came = true;
    }

    /// `dt_ns` pass. True: the watchdog has just expired, and the device has gone from OP to SafeOP.
    ///
    /// The step right after outputs does not count, however long it is, since a cycle may be longer than the watchdog.
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
