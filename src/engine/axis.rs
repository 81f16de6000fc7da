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
    Down,
    /// SV_ON under way.
    Rising,
    /// Operation enabled was reached; the controlword holds it.
    Up,
    /// SV_OFF under way.
    Falling,
    /// SV_OFF under way, and an SV_ON has come after it.
    Turning,
}

/// What commands have asked of an axis, and how far its outputs have come with it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Asked {
    power: Power,
    fault_reset: FaultReset,
    /// What goes to the drive, but for the fault reset and bit 4 of homing.
    pub(super) out: AxisOut,
}

/// Process data and walk of one axis.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Axis {
    pub(super) asked: Asked,
    /// The statusword said Operation enabled in the last cycle.
    enabled: bool,
    /// The statusword said Fault, or Fault reaction active, in the last cycle.
    faulted: bool,
    pub(super) homing: AxisHoming,
}

/// What a SET_FIFO clear goes back to when it takes back entries that a bus has taken ahead, but for the phase of homing:
/// that is kept of the few slaves that have one. It is small because it is kept in every cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Driven {
    asked: Asked,
    homing_rest: u8,
}

impl Driven {
    /// Whether these outputs ask for nothing: no motor, no output.
    pub(super) fn is_at_rest(&self) -> bool {
        let AxisOut { controlword, outputs, .. } = self.asked.out;
        controlword == Controlword::DISABLE_VOLTAGE && outputs == 0 && !self.asked.fault_reset.is_under_way()
    }
}

impl Axis {
    /// SV_ON. A Fault is not reset by it, and a request made in Fault is not kept: it would start the motor on a later
    /// ALM_CLR \[OURS].
    ///
    /// While an SV_OFF is under way it waits for its end \[OURS]: until then the statusword may still show Operation
    /// enabled of a drive that is on its way down.
    pub(super) fn switch_on(&mut self) {
        self.asked.power = match self.asked.power {
            Power::Up => Power::Up,
            Power::Falling | Power::Turning => Power::Turning,
            Power::Down | Power::Rising => Power::Rising,
        };
    }

    /// SV_OFF.
    pub(super) fn switch_off(&mut self) {
        if self.asked.power != Power::Down {
            self.asked.power = Power::Falling;
        }
    }

    /// ALM_CLR: a fault reset. Without a fault it has no effect \[OURS]: bit 7 would hold up a walk, or a drive that is
    /// on. It starts no motor: an axis in a fault has nothing under way.
    pub(super) fn clear_alarm(&mut self) {
        if self.faulted {
            self.asked.fault_reset.ask();
        }
    }

    /// Whether SV_ON is under way, or waits for the end of an SV_OFF.
    pub(super) const fn is_rising(&self) -> bool {
        matches!(self.asked.power, Power::Rising | Power::Turning)
    }

    /// Whether it follows targets now.
    pub(super) fn follows(&self) -> bool {
        self.enabled && self.asked.power == Power::Up
    }

    /// Whether the drive is in Operation enabled by SV_ON, in whatever mode.
    pub(super) fn is_up(&self) -> bool {
        self.asked.power == Power::Up
    }

    /// The next set of outputs to the drive, the one with that id.
    #[inline]
    pub(super) fn next_out(&mut self, id: u64) -> AxisOut {
        let mut out = self.asked.out;
        if self.homing.is_at_rest() && !self.asked.fault_reset.is_under_way() {
            return out;
        }
        if self.homing.next_bit(id) {
            out.controlword.0 |= Controlword::HOMING_START;
        }
        if self.asked.fault_reset.next_bit() {
            out.controlword.0 |= Controlword::FAULT_RESET;
        }
        out
    }

    /// Whether the next set of outputs has to differ from `last`, or may have to.
    pub(super) fn differs_from(&self, last: &AxisOut) -> bool {
        let mut next = self.asked.out;
        if self.homing.bit() {
            next.controlword.0 |= Controlword::HOMING_START;
        }
        self.asked.fault_reset.is_under_way() || self.homing.is_under_way() || next != *last
    }

    /// Takes a target if the axis follows targets now; false: it is not in Operation enabled by the board's own SV_ON.
    pub(super) fn aim(&mut self, target: i32) -> bool {
        let follows = self.follows();
        if follows {
            self.asked.out.target = target;
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
        self.homing.watch(at, written == Mode::Homing.code(), input.statusword);
        self.enabled = state == Some(DriveState::OperationEnabled) && in_mode;
        self.faulted = matches!(state, Some(DriveState::Fault | DriveState::FaultReactionActive));
        if !self.faulted {
            self.asked.fault_reset.end();
        }
        self.walk(state);
        if !self.enabled {
            self.asked.out.target = holding(input, Some(mode));
        }
    }

    /// Its slave is lost: nothing is under way any more, and no motor starts when it comes back. The target holds it
    /// where it was measured last.
    pub(super) fn lose(&mut self, input: &AxisIn, mode: Option<Mode>) {
        let target = holding(input, mode);
        *self = Self::default();
        self.asked.out.target = target;
    }

    /// How it is driven by the outputs made last.
    pub(super) const fn driven(&self) -> Driven {
        Driven { asked: self.asked, homing_rest: self.homing.rest() }
    }

    /// What was asked since `then` is taken back: SET_FIFO has cleared it. An axis that is off stays off: no motor starts
    /// because of entries that went, not even for the time until the next answer \[OURS]. One that does not follow is held
    /// where it was measured last, not where it was then. `homing`: where it was on its way home; `None`: it was not.
    pub(super) fn go_back_to(&mut self, then: &Driven, homing: Option<&AxisHoming>) {
        let mut asked = then.asked;
        if self.asked.power == Power::Down {
            (asked.power, asked.out.controlword) = (Power::Down, Controlword::DISABLE_VOLTAGE);
        }
        if !self.enabled {
            asked.out.target = self.asked.out.target;
        }
        self.asked = asked;
        self.homing.go_back_to(homing.unwrap_or(&AxisHoming::idle(then.homing_rest)));
    }

    fn walk(&mut self, state: Option<DriveState>) {
        use DriveState::*;
        let Some(state) = state else { return };
        let (power, controlword) = match (self.asked.power, state) {
            (Power::Rising, SwitchOnDisabled) => (Power::Rising, Controlword::SHUTDOWN),
            (Power::Rising, ReadyToSwitchOn) => (Power::Rising, Controlword::SWITCH_ON),
            (Power::Rising, SwitchedOn) => (Power::Rising, Controlword::ENABLE_OPERATION),
            (Power::Rising | Power::Up, OperationEnabled) => (Power::Up, Controlword::ENABLE_OPERATION),
            (Power::Rising, NotReadyToSwitchOn) => return,
            (Power::Rising, QuickStopActive) => (Power::Rising, Controlword::DISABLE_VOLTAGE),
            (power @ (Power::Falling | Power::Turning), OperationEnabled) => (power, Controlword::SWITCH_ON),
            (power @ (Power::Falling | Power::Turning), SwitchedOn) => (power, Controlword::SHUTDOWN),
            (power @ (Power::Falling | Power::Turning), ReadyToSwitchOn) => (power, Controlword::DISABLE_VOLTAGE),
            (Power::Turning, SwitchOnDisabled) => (Power::Rising, Controlword::SHUTDOWN),
            // A fault ends a walk, and a drive that leaves Operation enabled by itself is not brought back by the
            // board [OURS]: the motor starts by SV_ON alone.
            _ => (Power::Down, Controlword::DISABLE_VOLTAGE),
        };
        self.asked.power = power;
        self.asked.out.controlword = controlword;
    }
}

/// The target that holds an axis where it is (SK-7 \[OURS]): 0x607A = actual position, 0x60FF = 0, 0x6071 = 0.
fn holding(input: &AxisIn, mode: Option<Mode>) -> i32 {
    if mode == Some(Mode::Csp) { input.position } else { 0 }
}
