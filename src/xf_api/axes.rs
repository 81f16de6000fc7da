//! Axes under the chip's CiA 402 helper, which drives their state machines.

use std::time::Duration;

use super::{ProcessData, Xf, XfError};
use crate::ethercat::Ns;
use crate::ethercat::cia402::DriveState;
use crate::ethercat::coe::ObjectAddress;
use crate::link::chip_link::ChipLink;
use crate::xf::CommandCode;
use crate::xf::host::SLOT_BYTES;
use crate::xf::request::{
    Call, Encode, HelperConfigSet, HelperControl, HelperControlSet, HelperStateGet, HelperStateSet, MotorNumber,
    SlaveNumber,
};

const CONTROLWORD: ObjectAddress = ObjectAddress::new(0x6040, 0);
const STATUSWORD: ObjectAddress = ObjectAddress::new(0x6041, 0);

/// How long an axis may take to reach a state. \[OURS]
const AXIS_LIMIT: Duration = Duration::from_secs(5);

/// An axis whose state machine the helper drives.
#[derive(Clone, Copy, Debug)]
pub(super) struct HelperAxis {
    motor: MotorNumber,
    slave: SlaveNumber,
}

impl<L: ChipLink> Xf<L> {
    /// Gives a slave's controlword and statusword to the helper, which from then on drives the state machine of axis
    /// `motor`, 0..=127. The axis stays off until [`Self::enable`].
    ///
    /// # Errors
    /// [`XfError::NotMapped`] if the slave does not map both words, [`XfError::BeyondHelperRange`] if one of them is
    /// not among the first 256 bytes of the slave's process data, [`XfError::AxisOn`] if axis `motor` may be on,
    /// [`XfError::SlaveHasAxis`] if the slave has another axis, [`XfError::NoSuchSlave`] if there is no such slave;
    /// otherwise as with [`Xf::run`].
    pub fn add_axis(&mut self, motor: u8, slave: u8, data: &ProcessData) -> Result<(), XfError> {
        let controlword = data.output::<u16>(slave, CONTROLWORD)?.offset();
        let statusword = data.input::<u16>(slave, STATUSWORD)?.offset();
        let index = usize::from(slave);
        let offset = |object, at: usize, begin: usize| {
            u8::try_from(at - begin).map_err(|_| XfError::BeyondHelperRange { slave, object, at: at - begin })
        };
        let controlword_offset = offset(CONTROLWORD, controlword, data.layout().outputs[index].at)?;
        let statusword_offset = offset(STATUSWORD, statusword, data.layout().inputs[index].at)?;
        let (number, slave) = (number(motor)?, self.slave(slave)?);
        if self.on.contains(number) {
            return Err(XfError::AxisOn { motor });
        }
        if let Some(other) = self.axes.iter().find(|axis| axis.slave == slave && axis.motor != number) {
            return Err(XfError::SlaveHasAxis { slave: slave.get(), motor: other.motor.get() });
        }
        self.axes.retain(|axis| axis.motor != number);
        self.axes.push(HelperAxis { motor: number, slave });
        let control = HelperControl::ON;
        self.run(&HelperConfigSet { motor: number, controlword_offset, statusword_offset, control, slave })
    }

    /// Switches an axis on and waits until it is in Operation enabled. A fault has to be reset first.
    ///
    /// In CSP the drive follows its target position as soon as it is enabled. So the target that the program sends at
    /// this time has to equal the actual position.
    ///
    /// # Errors
    /// [`XfError::NoAxis`] if the axis was not added, [`XfError::AxisStuck`] if it is in another state after 5 s;
    /// otherwise as with [`Xf::run`].
    pub fn enable(&mut self, motor: u8) -> Result<(), XfError> {
        self.request_state(motor, DriveState::OperationEnabled)
    }

    /// Switches an axis off and waits until it is in Switch on disabled.
    ///
    /// # Errors
    /// As with [`Self::enable`].
    pub fn disable(&mut self, motor: u8) -> Result<(), XfError> {
        self.request_state(motor, DriveState::SwitchOnDisabled)
    }

    /// Resets the fault of an axis and waits until it is in Switch on disabled.
    ///
    /// # Errors
    /// As with [`Self::enable`].
    pub fn reset_fault(&mut self, motor: u8) -> Result<(), XfError> {
        let number = number(motor)?;
        let motors = self.axes.len() as u8;
        let axis = self.axes.iter().find(|axis| axis.motor == number).ok_or(XfError::NoAxis { motor })?;
        let (slave, control) = (axis.slave, HelperControl::ON | HelperControl::RESET_ONCE);
        self.run(&HelperStateSet { motor: number, state: DriveState::SwitchOnDisabled })?;
        self.run(&HelperControlSet { motor: number, control, motors, slave })?;
        self.wait_for(motor, DriveState::SwitchOnDisabled)?;
        self.on.remove(number);
        Ok(())
    }

    /// The CiA 402 state of an axis that the helper drives; `None` if the statusword encodes no state.
    ///
    /// # Errors
    /// As with [`Xf::run`]; the chip refuses an axis that was not added.
    pub fn axis_state(&mut self, motor: u8) -> Result<Option<DriveState>, XfError> {
        Ok(self.run(&HelperStateGet { motor: number(motor)? })?.state())
    }

    fn request_state(&mut self, motor: u8, state: DriveState) -> Result<(), XfError> {
        let number = number(motor)?;
        if !self.axes.iter().any(|axis| axis.motor == number) {
            return Err(XfError::NoAxis { motor });
        }
        self.run(&HelperStateSet { motor: number, state })?;
        self.wait_for(motor, state)?;
        if state == DriveState::SwitchOnDisabled {
            self.on.remove(number);
        }
        Ok(())
    }

    /// Waits until an axis is in the wanted state.
    fn wait_for(&mut self, motor: u8, wanted: DriveState) -> Result<(), XfError> {
        let begin: Ns = self.link.now();
        loop {
            let found = self.axis_state(motor)?;
            if found == Some(wanted) {
                return Ok(());
            }
            let waited = Duration::from_nanos(self.link.now() - begin);
            if waited > AXIS_LIMIT {
                let found = found.map_or("no state", DriveState::name);
                return Err(XfError::AxisStuck { motor, found, wanted: wanted.name(), waited });
            }
        }
    }

    /// Marks an axis as possibly on before a command that may switch it on is sent, because the answer may be lost.
    pub(super) fn note_axis<'d>(&mut self, call: &impl Call<'d>) {
        if let Ok((CommandCode::HelperStateSet, arguments)) = call.command(&mut [0; SLOT_BYTES])
            && arguments.info[0] != DriveState::SwitchOnDisabled.status_bits()
            && let Ok(motor) = number(arguments.parameter)
        {
            self.on.insert(motor);
            self.moves = true;
        }
    }
}

fn number(motor: u8) -> Result<MotorNumber, XfError> {
    Ok(MotorNumber::decode(motor)?)
}
