//! The CiA 402 helper: in each cycle the chip writes bits 0 to 3 of the axes' controlwords into the outputs. So each
//! drive goes to the state that the host has chosen.

use crate::ethercat::cia402::{Controlword, DriveState, Statusword};
use crate::xf::chip::network::ImageRanges;
use crate::xf::request::{HelperConfigSet, HelperControl, HelperControlSet};

/// Number of axes that the chip supports.
const MOTORS: usize = 128;
/// `[OURS]` Number of cycles for which the fault reset bit is set. The bit is then clear for one cycle more, so that
/// the next reset has a rising edge.
const RESET_CYCLES: u8 = 8;
/// Bits 0 to 3 of the controlword, which drive the state machine.
const STATE_MACHINE_BITS: u16 = 0x0F;

/// An axis, as configured by 402_CONFIG_SET.
#[derive(Clone, Copy)]
struct Axis {
    slave: u8,
    controlword_at: u16,
    statusword_at: u16,
    control: HelperControl,
    target: DriveState,
    /// For the timing of the fault reset bit: the number of cycles for which the axis has been in Fault while its control byte
    /// selects a reset. It begins again at 1 after each reset pulse and the pause that follows it.
    in_fault: u8,
}

/// The axes of the CiA 402 helper by motor number; `None` for an axis that is not configured.
pub(super) struct Helper {
    axes: [Option<Axis>; MOTORS],
}

impl Helper {
    pub const fn new() -> Self {
        Self { axes: [None; MOTORS] }
    }

    /// 402_CONFIG_SET. `[OURS]` The target state is Switch on disabled until 402_STATE_SET sets another one.
    pub fn configure(&mut self, request: &HelperConfigSet) {
        self.axes[usize::from(request.motor.get())] = Some(Axis {
            slave: request.slave.get(),
            controlword_at: request.controlword_offset.into(),
            statusword_at: request.statusword_offset.into(),
            control: request.control,
            target: DriveState::SwitchOnDisabled,
            in_fault: 0,
        });
    }

    /// 402_STATE_SET; returns false if the axis is not configured.
    pub fn set_target(&mut self, motor: u8, target: DriveState) -> bool {
        self.axis_mut(motor).map(|axis| axis.target = target).is_some()
    }

    /// 402_CTL_SET; returns false if the axis is not configured. `[OURS]` The axis gets the slave of the request; the number of
    /// motors in the request is ignored.
    ///
    /// With `defaults` an axis that is not configured is configured, with controlword and statusword at the beginning
    /// of the slave's PDOs (OBS: the vendor's driver 0.1 sets offsets "if the default is not fit"). The host itself has
    /// to write a mode of operation that is mapped after the controlword, since no command gives the helper its
    /// position.
    pub fn set_control(&mut self, request: &HelperControlSet, defaults: bool) -> bool {
        let (motor, control, slave) = (request.motor, request.control, request.slave);
        if defaults && self.axes[usize::from(motor.get())].is_none() {
            self.configure(&HelperConfigSet { motor, controlword_offset: 0, statusword_offset: 0, control, slave });
        }
        let set = |axis: &mut Axis| (axis.control, axis.slave, axis.in_fault) = (control, slave.get(), 0);
        self.axis_mut(motor.get()).map(set).is_some()
    }

    /// The control byte of an axis; `None` if the axis is not configured.
    pub fn control(&self, motor: u8) -> Option<HelperControl> {
        self.axes[usize::from(motor)].map(|axis| axis.control)
    }

    /// The statusword in the inputs, or 0 if the TxPDO is too short; `None` if the axis is not configured.
    pub fn statusword(&self, motor: u8, places: &[ImageRanges], inputs: &[u8]) -> Option<Statusword> {
        self.axes[usize::from(motor)].map(|axis| axis.statusword(places, inputs).unwrap_or_default())
    }

    /// Overwrites bits 0 to 3 of the controlwords in the outputs of a cycle, and the fault reset bit of axes whose control byte
    /// selects a reset.
    pub fn drive_state_machines(&mut self, places: &[ImageRanges], outputs: &mut [u8], inputs: &[u8]) {
        for axis in self.axes.iter_mut().flatten().filter(|axis| axis.control.contains(HelperControl::ON)) {
            axis.drive_state_machine(places, outputs, inputs);
        }
    }

    fn axis_mut(&mut self, motor: u8) -> Option<&mut Axis> {
        self.axes[usize::from(motor)].as_mut()
    }
}

impl Axis {
    fn statusword(&self, places: &[ImageRanges], inputs: &[u8]) -> Option<Statusword> {
        let image = inputs.get(places.get(usize::from(self.slave))?.inputs())?;
        let word = image.get(usize::from(self.statusword_at)..)?.first_chunk()?;
        Some(Statusword(u16::from_le_bytes(*word)))
    }

    fn drive_state_machine(&mut self, places: &[ImageRanges], outputs: &mut [u8], inputs: &[u8]) {
        let state = self.statusword(places, inputs).and_then(Statusword::state);
        let Some(image) = places.get(usize::from(self.slave)).and_then(|place| outputs.get_mut(place.outputs())) else {
            return;
        };
        let place = image.get_mut(usize::from(self.controlword_at)..);
        let Some(word) = place.and_then(|place| place.first_chunk_mut()) else { return };
        let resets = self.control.0 & (HelperControl::RESET_ONCE.0 | HelperControl::RESET_ALWAYS.0) != 0;
        let mut controlword = u16::from_le_bytes(*word) & !STATE_MACHINE_BITS | command(state, self.target).0;
        if resets {
            controlword &= !Controlword::FAULT_RESET;
            if self.gives_reset(state) {
                controlword |= Controlword::FAULT_RESET;
            }
        }
        *word = controlword.to_le_bytes();
    }

    /// Whether the fault reset bit is set in this cycle. A reset acts at a rising edge, so in Fault the bit is set for
    /// [`RESET_CYCLES`] cycles and then clear before the next reset.
    ///
    /// `[OURS]` RESET_ONCE clears itself after its reset was sent.
    fn gives_reset(&mut self, state: Option<DriveState>) -> bool {
        if state != Some(DriveState::Fault) {
            if self.in_fault > 1 {
                self.control = self.control.without(HelperControl::RESET_ONCE);
            }
            self.in_fault = 0;
            return false;
        }
        self.in_fault += 1;
        if self.in_fault > 1 + 2 * RESET_CYCLES {
            self.in_fault = 1;
        }
        if self.in_fault == 2 + RESET_CYCLES {
            self.control = self.control.without(HelperControl::RESET_ONCE);
        }
        // In the first cycle in Fault the bit is clear, so that there is a rising edge whatever its value was before. It is set
        // from the second cycle on.
        (2..2 + RESET_CYCLES).contains(&self.in_fault)
    }
}

/// Bits 0 to 3 of the controlword that take the axis from a state towards a target (CiA 402-2, table of commands).
///
/// `[OURS]` Targets that no command reaches (Not ready, Fault reaction, Fault) are treated as Switch on disabled. An axis
/// in Quick stop active reaches Operation enabled by Disable voltage first, since not every drive supports the direct
/// transition.
const fn command(state: Option<DriveState>, target: DriveState) -> Controlword {
    use DriveState::{OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
    /// Quick stop: only bit 1 is set.
    const QUICK_STOP: Controlword = Controlword(0x02);
    match (target, state) {
        (QuickStopActive, _) => QUICK_STOP,
        (ReadyToSwitchOn | SwitchedOn | OperationEnabled, Some(SwitchOnDisabled)) => Controlword::SHUTDOWN,
        (ReadyToSwitchOn, Some(ReadyToSwitchOn | SwitchedOn | OperationEnabled)) => Controlword::SHUTDOWN,
        (SwitchedOn, Some(ReadyToSwitchOn | SwitchedOn | OperationEnabled)) => Controlword::SWITCH_ON,
        (OperationEnabled, Some(ReadyToSwitchOn)) => Controlword::SWITCH_ON,
        (OperationEnabled, Some(SwitchedOn | OperationEnabled)) => Controlword::ENABLE_OPERATION,
        _ => Controlword::DISABLE_VOLTAGE,
    }
}
