//! One CiA 402 axis as the board drives it: the controlwords of SV_ON and SV_OFF, the fault reset of ALM_CLR, and the
//! targets. Until an axis follows commands, its target holds it where it is: the actual position in CSP, 0 in CSV and CST.

use super::fault_reset::FaultReset;
use super::homing::AxisHoming;
use crate::ethercat::cia402::{Controlword, DriveState, Mode};
use crate::fieldbus::{AxisIn, AxisOut, MAX_AXES, MAX_SLAVES, Ns};

/// The power state that SV_ON or SV_OFF has requested of an axis, and whether it is reached.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Power {
    /// Off, after SV_OFF or because the drive left Operation enabled by itself. The controlword stays at Disable
    /// voltage.
    #[default]
    Off,
    /// SV_ON is in progress.
    SwitchingOn,
    /// SV_ON has brought the drive to Operation enabled, and the controlword stays at Enable operation.
    On,
    /// SV_OFF is in progress.
    SwitchingOff,
    /// SV_OFF is in progress, and an SV_ON that came after it waits.
    SwitchingOffThenOn,
}

/// What commands have requested of an axis, and the outputs that the board sends to the drive because of that.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisRequest {
    power: Power,
    fault_reset: FaultReset,
    /// Controlword, target and digital outputs for the drive; bits 7 (fault reset) and 4 (homing start) of the
    /// controlword are added by [`Axis::next_out`].
    pub(super) out: AxisOut,
}

/// Counts how often requests such as SV_ON ended for a reason other than a command. A rollback, in which SET_FIFO 1 takes
/// commands back, compares the counts with those at a checkpoint: a request that the drive or a loss has ended since must not
/// come back. Both counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Ends {
    /// How often a statusword of the drive has ended an SV_ON or SV_OFF.
    by_drive: u8,
    /// How often the loss of the slave has ended all requests.
    by_loss: u8,
}

/// Which sets of outputs were sent when the answer of a cycle is evaluated, and which set is next. A set of outputs is
/// the process data that all slaves get in one cycle.
#[derive(Clone, Copy, Debug)]
pub(super) struct OutputIds {
    /// All sets of outputs with a lower id are known to be sent.
    pub(super) sent_until: u64,
    /// The id of the next set of outputs that is pushed to the bus.
    pub(super) next: u64,
}

/// The state of one axis: its requests, what its statusword showed last, and its homing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Axis {
    pub(super) requested: AxisRequest,
    /// The id of a set of outputs. Once all sets with a lower id are sent, the drive has received the present
    /// controlword. 0: the drive has received it already.
    asked_until: u64,
    /// Whether the statusword of the last cycle showed Operation enabled, with the axis in the mode that DRIVE_MODE has set.
    enabled: bool,
    /// Whether the statusword of the last cycle showed Fault or Fault reaction active.
    faulted: bool,
    ends: Ends,
    pub(super) homing: AxisHoming,
}

/// The axes of all slaves.
pub(super) type AllAxes = [[Axis; MAX_AXES]; MAX_SLAVES];

/// Resets all axes one by one, without a copy of the whole array on the stack.
pub(super) fn reset(axes: &mut AllAxes) {
    axes.iter_mut().flatten().for_each(|axis| *axis = Axis::default());
}

/// The state of an axis when a set of outputs was made. If SET_FIFO 1 (clear) drops outputs that a bus has queued, the
/// axis returns to its state at the newest set that was sent.
///
/// A checkpoint is recorded for each axis with every set of outputs, so it is small. The homing phase is recorded
/// separately, for the few slaves that are homing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisCheckpoint {
    requested: AxisRequest,
    ends: Ends,
    homing_low_sets: u8,
}

impl AxisCheckpoint {
    /// Whether outputs made from this state switch on neither a motor nor a digital output. Only such outputs may be in
    /// the queue of a bus when a lost slave returns to OP.
    pub(super) fn is_at_rest(&self) -> bool {
        let AxisOut { controlword, outputs, .. } = self.requested.out;
        controlword == Controlword::DISABLE_VOLTAGE && outputs == 0 && !self.requested.fault_reset.is_under_way()
    }
}

impl Axis {
    /// SV_ON. It does not reset a fault. In the state Fault the request is dropped, since otherwise a later ALM_CLR
    /// would start the motor \[OURS].
    ///
    /// An SV_ON during an SV_OFF waits until the SV_OFF has ended \[OURS]: until then the statusword may still show
    /// Operation enabled while the drive is switching off.
    pub(super) fn switch_on(&mut self) {
        self.requested.power = match self.requested.power {
            Power::On => Power::On,
            Power::SwitchingOff | Power::SwitchingOffThenOn => Power::SwitchingOffThenOn,
            Power::Off | Power::SwitchingOn => Power::SwitchingOn,
        };
    }

    /// SV_OFF: switches the axis off through the CiA 402 states, one transition at a time.
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

    /// Whether SV_ON is in progress, or waits for the end of an SV_OFF.
    pub(super) const fn is_switching_on(&self) -> bool {
        matches!(self.requested.power, Power::SwitchingOn | Power::SwitchingOffThenOn)
    }

    /// Whether the axis follows targets: SV_ON has enabled it, and it is in the mode that DRIVE_MODE has set.
    pub(super) fn follows(&self) -> bool {
        self.enabled && self.requested.power == Power::On
    }

    /// Whether SV_ON has brought the drive to Operation enabled, in any mode of operation.
    pub(super) fn is_on(&self) -> bool {
        self.requested.power == Power::On
    }

    /// The axis' part of the next set of outputs, whose id is `id`. If the set has bit 4, the start of homing, homing
    /// notes this id: so it later recognises the first answer of the drive to that bit.
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

    /// Whether the axis's part of the next set of outputs may differ from `last`, its part of the set that was pushed
    /// last.
    pub(super) fn differs_from(&self, last: &AxisOut) -> bool {
        let mut next = self.requested.out;
        if self.homing.start_bit() {
            next.controlword.0 |= Controlword::HOMING_START;
        }
        self.requested.fault_reset.is_under_way() || self.homing.is_under_way() || next != *last
    }

    /// Takes a target if the axis follows targets now. Returns false if it does not: SV_ON has not brought it to Operation
    /// enabled, or it is not in the mode that DRIVE_MODE has set.
    pub(super) fn set_target(&mut self, target: i32) -> bool {
        let follows = self.follows();
        if follows {
            self.requested.out.target = target;
        }
        follows
    }

    /// Called after a write of 0x6060. If the newest statusword (`newest`) shows Operation enabled and the axis is in the mode
    /// that DRIVE_MODE has set (`in_mode`), the axis takes targets at once: the target of the next FIFO entry is not discarded.
    pub(super) fn mode_written(&mut self, newest: Option<DriveState>, in_mode: bool) {
        self.enabled = newest == Some(DriveState::OperationEnabled) && in_mode;
    }

    /// Takes the inputs of the cycle at `at`: chooses the next controlword and, while the axis does not follow targets,
    /// the target that holds it at its actual position. `written` is the value written to 0x6060 last.
    ///
    /// Once the axis is enabled this holding target stays unchanged until the first motion command, so that a load
    /// cannot drag the axis and its target along.
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

    /// Called when the slave of the axis is lost: all requests end, so that no motor starts when the slave comes back.
    /// The target holds the axis at the position in `input`, the last inputs of the slave.
    pub(super) fn lose(&mut self, input: &AxisIn, mode: Option<Mode>) {
        let ends = Ends { by_loss: self.ends.by_loss.wrapping_add(1), ..self.ends };
        *self = Self { ends, ..Self::default() };
        self.requested.out.target = holding_target(input, mode);
    }

    /// A copy of the axis' requests after the newest outputs, to which [`Self::roll_back_to`] can return.
    pub(super) const fn checkpoint(&self) -> AxisCheckpoint {
        AxisCheckpoint { requested: self.requested, ends: self.ends, homing_low_sets: self.homing.low_sets_left() }
    }

    /// Takes back all requests since `then`, because SET_FIFO 1 has cleared the FIFO entries with these commands.
    ///
    /// An axis that is off, or was off at any time since `then`, stays off: clearing entries starts no motor, not even
    /// until the next answer \[OURS]. If the drive has ended an SV_ON that was sent, clearing a later SV_ON does not
    /// undo that end. An axis that does not follow targets is held at its newest measured position, not at the position
    /// of `then`. If the slave was lost since `then`, the axis gets the state after the return of the slave: motor and
    /// digital outputs off.
    ///
    /// `newest`: the drive state in the newest answer. `homing`: the homing state at `then`; `None`: the axis was not
    /// homing. `next`: the id of the outputs that are pushed next.
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
            // The drive may have left Operation enabled while the SV_OFF and SV_ON that are now taken back waited in
            // the queue of the bus: the newest statusword decides.
            self.follow_statusword(newest, next);
        }
        self.homing.roll_back_to(homing.unwrap_or(&AxisHoming::idle(then.homing_low_sets)));
    }

    /// Whether the statusword answers an older controlword, because the present one has not reached the drive yet. On a
    /// bus that queues outputs, SV_ON must not act on such a statusword: it would repeat a transition that is done
    /// already, and switch off an enabled drive for one cycle. A statusword that shows the next state, or a fault,
    /// counts at once.
    fn is_answered_late(&self, state: Option<DriveState>, ids: OutputIds) -> bool {
        let AxisOut { controlword, .. } = self.requested.out;
        if self.asked_until <= ids.sent_until {
            return false;
        }
        let (Some(shown), Some(asked)) = (state.and_then(height), height_asked(controlword)) else { return false };
        match self.requested.power {
            Power::Off | Power::On => false,
            // Disable voltage was not sent to the drive yet, so this statusword answers an earlier controlword.
            Power::SwitchingOn if asked == 0 => true,
            Power::SwitchingOn => shown + 1 < asked,
            Power::SwitchingOffThenOn if shown == 0 => true,
            Power::SwitchingOff | Power::SwitchingOffThenOn => shown > asked + 1,
        }
    }

    /// Requests the next CiA 402 transition that SV_ON or SV_OFF needs, as far as the drive state allows it. `next`:
    /// the id of the outputs that are pushed next.
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
            // A fault ends SV_ON and SV_OFF. The board does not enable a drive again that has left Operation enabled by
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

/// The rank of a drive state on the way to Operation enabled: 0 for Switch on disabled, 3 for Operation enabled. `None`
/// for states that are not on this way.
const fn height(state: DriveState) -> Option<u8> {
    match state {
        DriveState::SwitchOnDisabled => Some(0),
        DriveState::ReadyToSwitchOn => Some(1),
        DriveState::SwitchedOn => Some(2),
        DriveState::OperationEnabled => Some(3),
        _ => None,
    }
}

/// The rank of the drive state that a controlword requests, as in [`height`].
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
