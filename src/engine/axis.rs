//! One CiA 402 axis as the board drives it: the controlwords of SV_ON and SV_OFF, the fault reset of ALM_CLR, and targets
//! that hold an axis in place until it follows commands.

use super::fault_reset::FaultReset;
use super::homing::AxisHoming;
use crate::ethercat::cia402::{Controlword, DriveState, Mode};
use crate::fieldbus::{AxisIn, AxisOut, Ns};

/// The power stage as the last commands want it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Power {
    /// Off, by SV_OFF or because the drive has left Operation enabled by itself: the controlword stays at Disable voltage.
    #[default]
    Off,
    /// SV_ON is under way.
    SwitchingOn,
    /// Operation enabled was reached, and the controlword keeps it.
    On,
    /// SV_OFF is under way.
    SwitchingOff,
    /// SV_OFF is under way, and an SV_ON came after it.
    SwitchingOffThenOn,
}

/// What commands have requested of an axis, and how far its outputs have got with it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisRequest {
    power: Power,
    fault_reset: FaultReset,
    /// The outputs to the drive without bit 7 (fault reset) and bit 4 (homing start) of the controlword.
    pub(super) out: AxisOut,
}

/// How often something other than a command has ended what commands had requested of an axis; both wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Ends {
    /// An answer of the drive has ended an SV_ON or SV_OFF.
    by_drive: u8,
    /// The slave was lost, which has ended all requests.
    by_loss: u8,
}

/// The ids of outputs when the answer of a cycle comes.
#[derive(Clone, Copy, Debug)]
pub(super) struct OutputIds {
    /// Outputs before this one are known to be sent.
    pub(super) sent_until: u64,
    /// The outputs that are pushed next.
    pub(super) next: u64,
}

/// One axis as the board drives it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Axis {
    pub(super) requested: AxisRequest,
    /// Until outputs before this one are sent, the drive has not got the present controlword; 0: it has.
    asked_until: u64,
    /// The statusword of the last cycle showed Operation enabled, in the mode of DRIVE_MODE.
    enabled: bool,
    /// The statusword of the last cycle showed Fault or Fault reaction active.
    faulted: bool,
    ends: Ends,
    pub(super) homing: AxisHoming,
}

/// The state of an axis to which a SET_FIFO clear returns when it takes back entries that a bus has taken ahead. It is
/// recorded in every cycle and therefore small: the phase of homing is recorded only for the few slaves that have one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisCheckpoint {
    requested: AxisRequest,
    ends: Ends,
    homing_low_sets: u8,
}

impl AxisCheckpoint {
    /// Whether these outputs switch on no motor and no digital output.
    pub(super) fn is_at_rest(&self) -> bool {
        let AxisOut { controlword, outputs, .. } = self.requested.out;
        controlword == Controlword::DISABLE_VOLTAGE && outputs == 0 && !self.requested.fault_reset.is_under_way()
    }
}

impl Axis {
    /// SV_ON. It does not reset a fault, and in the state Fault it is not kept: else a later ALM_CLR would start the motor
    /// \[OURS].
    ///
    /// An SV_ON during an SV_OFF waits for its end \[OURS]: until then the statusword may still show Operation enabled
    /// while the drive is switching off.
    pub(super) fn switch_on(&mut self) {
        self.requested.power = match self.requested.power {
            Power::On => Power::On,
            Power::SwitchingOff | Power::SwitchingOffThenOn => Power::SwitchingOffThenOn,
            Power::Off | Power::SwitchingOn => Power::SwitchingOn,
        };
    }

    /// SV_OFF: switches the axis off through the states of CiA 402.
    pub(super) fn switch_off(&mut self) {
        if self.requested.power != Power::Off {
            self.requested.power = Power::SwitchingOff;
        }
    }

    /// ALM_CLR: a fault reset. Without a fault it has no effect \[OURS], since with bit 7 set a drive ignores the other
    /// bits of the controlword. It starts no motor, since a fault has ended every SV_ON.
    pub(super) fn clear_alarm(&mut self) {
        if self.faulted {
            self.requested.fault_reset.request();
        }
    }

    /// Whether SV_ON is under way, or waits for the end of an SV_OFF.
    pub(super) const fn is_switching_on(&self) -> bool {
        matches!(self.requested.power, Power::SwitchingOn | Power::SwitchingOffThenOn)
    }

    /// Whether the axis follows targets now.
    pub(super) fn follows(&self) -> bool {
        self.enabled && self.requested.power == Power::On
    }

    /// Whether SV_ON has brought the drive to Operation enabled, in whatever mode.
    pub(super) fn is_on(&self) -> bool {
        self.requested.power == Power::On
    }

    /// The outputs to the drive in the next set, which has that id.
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

    /// Whether the next set of outputs differs from `last`, or may do so.
    pub(super) fn differs_from(&self, last: &AxisOut) -> bool {
        let mut next = self.requested.out;
        if self.homing.start_bit() {
            next.controlword.0 |= Controlword::HOMING_START;
        }
        self.requested.fault_reset.is_under_way() || self.homing.is_under_way() || next != *last
    }

    /// Takes a target if the axis follows targets now. False: the axis is not in Operation enabled by SV_ON.
    pub(super) fn set_target(&mut self, target: i32) -> bool {
        let follows = self.follows();
        if follows {
            self.requested.out.target = target;
        }
        follows
    }

    /// 0x6060 was written. A drive that shows Operation enabled (`newest`) takes targets from the next outputs on if that is
    /// the mode of DRIVE_MODE: the entry that comes next is not too early for it.
    pub(super) fn mode_written(&mut self, newest: Option<DriveState>, in_mode: bool) {
        self.enabled = newest == Some(DriveState::OperationEnabled) && in_mode;
    }

    /// Takes the inputs of the cycle at `at`: chooses the next controlword and, while the axis does not follow, the
    /// target that holds it where it is. `written` is the value that was written to 0x6060 last.
    ///
    /// Once the axis is enabled the last such target stays until the first motion command, so that a load cannot move the
    /// axis and its target with it.
    pub(super) fn answer(&mut self, at: Ns, input: &AxisIn, mode: Mode, written: u8, ids: OutputIds) {
        let state = input.statusword.state();
        let in_mode = written == mode.code();
        self.homing.observe_idle(at, written == Mode::Homing.code(), input.statusword);
        self.enabled = state == Some(DriveState::OperationEnabled) && in_mode;
        self.faulted = matches!(state, Some(DriveState::Fault | DriveState::FaultReactionActive));
        if !self.faulted {
            self.requested.fault_reset.end();
        }
        if !self.is_answered_late(state, ids) {
            self.follow_statusword(state, ids.next);
        }
        if !self.enabled {
            self.requested.out.target = holding_target(input, Some(mode));
        }
    }

    /// The slave of the axis is lost: all requests end, so that no motor starts when the slave comes back. The target
    /// holds the axis where it was measured last.
    pub(super) fn lose(&mut self, input: &AxisIn, mode: Option<Mode>) {
        let ends = Ends { by_loss: self.ends.by_loss.wrapping_add(1), ..self.ends };
        *self = Self { ends, ..Self::default() };
        self.requested.out.target = holding_target(input, mode);
    }

    /// The state of the axis after the newest outputs, for [`Self::roll_back_to`].
    pub(super) const fn checkpoint(&self) -> AxisCheckpoint {
        AxisCheckpoint { requested: self.requested, ends: self.ends, homing_low_sets: self.homing.low_sets_left() }
    }

    /// Takes back what was requested since `then`, because SET_FIFO has cleared those entries. An axis that is off, or has been
    /// off since, is off: no motor starts because entries were cleared, not even for the time until the next answer \[OURS].
    /// What has ended an SV_ON that was sent is not undone by another one that was not. An axis that does not follow its target
    /// is held where it was measured last, not where it was then. If the slave was lost since, the axis returns to what it was
    /// when the slave came back: off, digital outputs too. `newest`: the state in the newest answer. `homing`: the state of
    /// homing then; `None`: the axis was not homing. `next`: the outputs that are pushed next.
    pub(super) fn roll_back_to(
        &mut self,
        then: &AxisCheckpoint,
        newest: Option<DriveState>,
        homing: Option<&AxisHoming>,
        next: u64,
    ) {
        let when_back = AxisCheckpoint { ends: self.ends, ..AxisCheckpoint::default() };
        let (then, homing) = if self.ends.by_loss != then.ends.by_loss { (&when_back, None) } else { (then, homing) };
        let mut requested = then.requested;
        if self.requested.power == Power::Off || self.ends != then.ends {
            (requested.power, requested.out.controlword) = (Power::Off, Controlword::DISABLE_VOLTAGE);
        }
        if !self.enabled {
            requested.out.target = self.requested.out.target;
        }
        self.requested = requested;
        self.asked_until = next + 1;
        if requested.power == Power::On {
            // The drive may have left Operation enabled while an SV_OFF and an SV_ON, which are taken back, were waiting.
            self.follow_statusword(newest, next);
        }
        self.homing.roll_back_to(homing.unwrap_or(&AxisHoming::idle(then.homing_low_sets)));
    }

    /// Whether the state answers an older controlword than the present one, which the drive has not got yet. An SV_ON that went
    /// by it would ask again for a step that is done: behind a bus that takes outputs ahead, a drive that is enabled already
    /// would be switched off for a cycle. What shows the next step, and a fault, counts at once.
    fn is_answered_late(&self, state: Option<DriveState>, ids: OutputIds) -> bool {
        let AxisOut { controlword, .. } = self.requested.out;
        if self.asked_until <= ids.sent_until {
            return false;
        }
        let (Some(shown), Some(asked)) = (state.and_then(height), height_asked(controlword)) else { return false };
        match self.requested.power {
            Power::Off | Power::On => false,
            // Whatever shows is from before the drive was switched off.
            Power::SwitchingOn if asked == 0 => true,
            Power::SwitchingOn => shown + 1 < asked,
            Power::SwitchingOffThenOn if shown == 0 => true,
            Power::SwitchingOff | Power::SwitchingOffThenOn => shown > asked + 1,
        }
    }

    /// Takes the next transition of SV_ON or SV_OFF that the state of the drive allows; `next`: the outputs that are pushed next.
    fn follow_statusword(&mut self, state: Option<DriveState>, next: u64) {
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
            // A fault ends SV_ON and SV_OFF, and the board does not enable a drive again that has left Operation enabled by
            // itself [OURS]: only SV_ON starts a motor.
            _ => (Power::Off, Controlword::DISABLE_VOLTAGE),
        };
        if power == Power::Off && self.requested.power != Power::Off {
            self.ends.by_drive = self.ends.by_drive.wrapping_add(1);
        }
        self.requested.power = power;
        if controlword != self.requested.out.controlword {
            self.requested.out.controlword = controlword;
            self.asked_until = next + 1;
        }
    }
}

/// How far a drive in that state is switched on: 0 in Switch on disabled, 3 in Operation enabled.
const fn height(state: DriveState) -> Option<u8> {
    match state {
        DriveState::SwitchOnDisabled => Some(0),
        DriveState::ReadyToSwitchOn => Some(1),
        DriveState::SwitchedOn => Some(2),
        DriveState::OperationEnabled => Some(3),
        _ => None,
    }
}

/// How far the controlword switches a drive on.
fn height_asked(controlword: Controlword) -> Option<u8> {
    [Controlword::DISABLE_VOLTAGE, Controlword::SHUTDOWN, Controlword::SWITCH_ON, Controlword::ENABLE_OPERATION]
        .iter()
        .zip(0..)
        .find_map(|(asked, height)| (*asked == controlword).then_some(height))
}

/// The target that holds an axis where it is (SK-7 \[OURS]): 0x607A = actual position, 0x60FF = 0, 0x6071 = 0.
fn holding_target(input: &AxisIn, mode: Option<Mode>) -> i32 {
    if mode == Some(Mode::Csp) { input.position } else { 0 }
}
