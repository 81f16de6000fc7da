//! One CiA 402 axis as the board drives it: the walk of SV_ON and SV_OFF, the fault reset of ALM_CLR, and targets that
//! never jump.

use super::fault_reset::FaultReset;
use super::homing::AxisHoming;
use crate::cia402::{Controlword, DriveState, Mode};
use crate::fieldbus::{AxisIn, AxisOut, Ns};

/// Where the board wants the axis to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Power {
    /// Off, or fallen off by itself: the controlword stays at Disable voltage.
    #[default]
    Off,
    /// SV_ON under way.
    SwitchingOn,
    /// Operation enabled was reached; the controlword holds it.
    On,
    /// SV_OFF under way.
    SwitchingOff,
    /// SV_OFF under way, and an SV_ON has come after it.
    SwitchingOffThenOn,
}

/// What commands have requested of an axis, and how far its outputs have come with it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisRequest {
    power: Power,
    fault_reset: FaultReset,
    /// What goes to the drive, but for the fault reset and bit 4 of homing.
    pub(super) out: AxisOut,
}

/// Process data and walk of one axis.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Axis {
    pub(super) requested: AxisRequest,
    /// The statusword said Operation enabled in the last cycle.
    enabled: bool,
    /// The statusword said Fault, or Fault reaction active, in the last cycle.
    faulted: bool,
    pub(super) homing: AxisHoming,
}

/// What a SET_FIFO clear goes back to when it takes back entries that a bus has taken ahead, but for the phase of homing:
/// that is kept of the few slaves that have one. It is small because it is kept in every cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisCheckpoint {
    requested: AxisRequest,
    homing_low_sets: u8,
}

impl AxisCheckpoint {
    /// Whether these outputs ask for nothing: no motor, no output.
    pub(super) fn is_at_rest(&self) -> bool {
        let AxisOut { controlword, outputs, .. } = self.requested.out;
        controlword == Controlword::DISABLE_VOLTAGE && outputs == 0 && !self.requested.fault_reset.is_under_way()
    }
}

impl Axis {
    /// SV_ON. A Fault is not reset by it, and a request made in Fault is not kept: it would start the motor on a later
    /// ALM_CLR \[OURS].
    ///
    /// While an SV_OFF is under way it waits for its end \[OURS]: until then the statusword may still show Operation
    /// enabled of a drive that is on its way down.
    pub(super) fn switch_on(&mut self) {
        self.requested.power = match self.requested.power {
            Power::On => Power::On,
            Power::SwitchingOff | Power::SwitchingOffThenOn => Power::SwitchingOffThenOn,
            Power::Off | Power::SwitchingOn => Power::SwitchingOn,
        };
    }

    /// SV_OFF.
    pub(super) fn switch_off(&mut self) {
        if self.requested.power != Power::Off {
            self.requested.power = Power::SwitchingOff;
        }
    }

    /// ALM_CLR: a fault reset. Without a fault it has no effect \[OURS]: bit 7 would hold up a walk, or a drive that is
    /// on. It starts no motor: an axis in a fault has nothing under way.
    pub(super) fn clear_alarm(&mut self) {
        if self.faulted {
            self.requested.fault_reset.request();
        }
    }

    /// Whether SV_ON is under way, or waits for the end of an SV_OFF.
    pub(super) const fn is_switching_on(&self) -> bool {
        matches!(self.requested.power, Power::SwitchingOn | Power::SwitchingOffThenOn)
    }

    /// Whether it follows targets now.
    pub(super) fn follows(&self) -> bool {
        self.enabled && self.requested.power == Power::On
    }

    /// Whether the drive is in Operation enabled by SV_ON, in whatever mode.
    pub(super) fn is_on(&self) -> bool {
        self.requested.power == Power::On
    }

    /// The next set of outputs to the drive, the one with that id.
    #[inline]
    pub(super) fn next_out(&mut self, id: u64) -> AxisOut {
        let mut out = self.requested.out;
        if self.homing.is_at_rest() && !self.requested.fault_reset.is_under_way() {
            return out;
        }
        if self.homing.next_bit(id) {
            out.controlword.0 |= Controlword::HOMING_START;
        }
        if self.requested.fault_reset.next_bit() {
            out.controlword.0 |= Controlword::FAULT_RESET;
        }
        out
    }

    /// Whether the next set of outputs has to differ from `last`, or may have to.
    pub(super) fn differs_from(&self, last: &AxisOut) -> bool {
        let mut next = self.requested.out;
        if self.homing.start_bit() {
            next.controlword.0 |= Controlword::HOMING_START;
        }
        self.requested.fault_reset.is_under_way() || self.homing.is_under_way() || next != *last
    }

    /// Takes a target if the axis follows targets now; false: it is not in Operation enabled by the board's own SV_ON.
    pub(super) fn set_target(&mut self, target: i32) -> bool {
        let follows = self.follows();
        if follows {
            self.requested.out.target = target;
        }
        follows
    }

    /// The answer of the cycle at `at`: the next step of a walk, and the target that holds the axis where it is while it does not
    /// follow. `written` is 0x6060 as it was written last.
    ///
    /// Once enabled the last such target stays until the first motion command: a load that pulls does not take the
    /// target along.
    pub(super) fn answer(&mut self, at: Ns, input: &AxisIn, mode: Mode, written: u8) {
        let state = input.statusword.state();
        let in_mode = written == mode.code();
        self.homing.observe_idle(at, written == Mode::Homing.code(), input.statusword);
        self.enabled = state == Some(DriveState::OperationEnabled) && in_mode;
        self.faulted = matches!(state, Some(DriveState::Fault | DriveState::FaultReactionActive));
        if !self.faulted {
            self.requested.fault_reset.end();
        }
        self.follow_statusword(state);
        if !self.enabled {
            self.requested.out.target = holding_target(input, Some(mode));
        }
    }

    /// Its slave is lost: nothing is under way any more, and no motor starts when it comes back. The target holds it
    /// where it was measured last.
    pub(super) fn lose(&mut self, input: &AxisIn, mode: Option<Mode>) {
        let target = holding_target(input, mode);
        *self = Self::default();
        self.requested.out.target = target;
    }

    /// What a clear goes back to if the outputs made last are the newest that were sent.
    pub(super) const fn checkpoint(&self) -> AxisCheckpoint {
        AxisCheckpoint { requested: self.requested, homing_low_sets: self.homing.low_sets_left() }
    }

    /// What was requested since `then` is taken back: SET_FIFO has cleared it. An axis that is off stays off: no motor starts
    /// because of entries that went, not even for the time until the next answer \[OURS]. One that does not follow is held
    /// where it was measured last, not where it was then. `homing`: where it was on its way home; `None`: it was not.
    pub(super) fn roll_back_to(&mut self, then: &AxisCheckpoint, homing: Option<&AxisHoming>) {
        let mut requested = then.requested;
        if self.requested.power == Power::Off {
            (requested.power, requested.out.controlword) = (Power::Off, Controlword::DISABLE_VOLTAGE);
        }
        if !self.enabled {
            requested.out.target = self.requested.out.target;
        }
        self.requested = requested;
        self.homing.roll_back_to(homing.unwrap_or(&AxisHoming::idle(then.homing_low_sets)));
    }

    fn follow_statusword(&mut self, state: Option<DriveState>) {
        use DriveState::*;
        let Some(state) = state else { return };
        let (power, controlword) = match (self.requested.power, state) {
            (Power::SwitchingOn, SwitchOnDisabled) => (Power::SwitchingOn, Controlword::SHUTDOWN),
            (Power::SwitchingOn, ReadyToSwitchOn) => (Power::SwitchingOn, Controlword::SWITCH_ON),
            (Power::SwitchingOn, SwitchedOn) => (Power::SwitchingOn, Controlword::ENABLE_OPERATION),
            (Power::SwitchingOn | Power::On, OperationEnabled) => (Power::On, Controlword::ENABLE_OPERATION),
            (Power::SwitchingOn, NotReadyToSwitchOn) => return,
            (Power::SwitchingOn, QuickStopActive) => (Power::SwitchingOn, Controlword::DISABLE_VOLTAGE),
            (power @ (Power::SwitchingOff | Power::SwitchingOffThenOn), OperationEnabled) => {
                (power, Controlword::SWITCH_ON)
            }
            (power @ (Power::SwitchingOff | Power::SwitchingOffThenOn), SwitchedOn) => (power, Controlword::SHUTDOWN),
            (power @ (Power::SwitchingOff | Power::SwitchingOffThenOn), ReadyToSwitchOn) => {
                (power, Controlword::DISABLE_VOLTAGE)
            }
            (Power::SwitchingOffThenOn, SwitchOnDisabled) => (Power::SwitchingOn, Controlword::SHUTDOWN),
            // A fault ends a walk, and a drive that leaves Operation enabled by itself is not brought back by the
            // board [OURS]: the motor starts by SV_ON alone.
            _ => (Power::Off, Controlword::DISABLE_VOLTAGE),
        };
        self.requested.power = power;
        self.requested.out.controlword = controlword;
    }
}

/// The target that holds an axis where it is (SK-7 \[OURS]): 0x607A = actual position, 0x60FF = 0, 0x6071 = 0.
fn holding_target(input: &AxisIn, mode: Option<Mode>) -> i32 {
    if mode == Some(Mode::Csp) { input.position } else { 0 }
}
