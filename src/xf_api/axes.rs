//! Axes by the CiA 402 helper of the chip, which leads their state machines.

use std::time::Duration;

use super::{ProcessData, Xf, XfError};
use crate::cia402::DriveState;
use crate::coe::ObjectAddress;
use crate::ethercat::Ns;
use crate::link::chip::ChipLink;
use crate::xf::request::{
    HelperConfigSet, HelperControl, HelperControlSet, HelperStateGet, HelperStateSet, MotorNumber, SlaveNumber,
};

const CONTROLWORD: ObjectAddress = ObjectAddress::new(0x6040, 0);
const STATUSWORD: ObjectAddress = ObjectAddress::new(0x6041, 0);

/// How long an axis may take to a state. \[OURS]
const AXIS_LIMIT: Duration = Duration::from_secs(5);

/// An axis that the helper leads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    pub(super) motor: MotorNumber,
    slave: SlaveNumber,
    /// It was led out of Switch on disabled.
    pub(super) on: bool,
}

impl<L: ChipLink> Xf<L> {
    /// Gives a slave's controlword and statusword to the helper, which leads the axis `motor`, 0..=127, from then on.
    /// Until [`Self::enable`] it leaves the axis off.
    ///
    /// # Errors
    /// [`XfError::NotMapped`] if the slave does not map both words, [`XfError::NoSuchSlave`], [`XfError::Chip`],
    /// [`XfError::Link`].
    pub fn add_axis(&mut self, motor: u8, slave: u8, data: &ProcessData) -> Result<(), XfError> {
        let controlword =
            data.output::<u16>(slave, CONTROLWORD)?.place() - data.layout().outputs[usize::from(slave)].at;
        let statusword = data.input::<u16>(slave, STATUSWORD)?.place() - data.layout().inputs[usize::from(slave)].at;
        let (motor, slave) = (number(motor)?, self.slave(slave)?);
        self.axes.retain(|axis| axis.motor != motor);
        self.axes.push(Axis { motor, slave, on: false });
        self.run(&HelperConfigSet {
            motor,
            controlword_offset: controlword as u8,
            statusword_offset: statusword as u8,
            control: HelperControl::ON,
            slave,
        })
    }

    /// Switches an axis on and waits until it is in Operation enabled. A fault has to be reset before.
    ///
    /// In CSP the drive follows its target from then on: the target that is sent has to be where it stands.
    ///
    /// # Errors
    /// [`XfError::NoAxis`], [`XfError::AxisStuck`], [`XfError::Chip`], [`XfError::Link`].
    pub fn enable(&mut self, motor: u8) -> Result<(), XfError> {
        self.lead(motor, DriveState::OperationEnabled)
    }

    /// Switches an axis off and waits until it is in Switch on disabled.
    ///
    /// # Errors
    /// As with [`Self::enable`].
    pub fn disable(&mut self, motor: u8) -> Result<(), XfError> {
        self.lead(motor, DriveState::SwitchOnDisabled)
    }

    /// Resets the fault of an axis and waits until it is in Switch on disabled.
    ///
    /// # Errors
    /// [`XfError::NoAxis`]; otherwise as with [`Self::enable`].
    pub fn reset_fault(&mut self, motor: u8) -> Result<(), XfError> {
        let number = number(motor)?;
        let motors = self.axes.len() as u8;
        let axis = self.axes.iter_mut().find(|axis| axis.motor == number).ok_or(XfError::NoAxis { motor })?;
        let (slave, control) = (axis.slave, HelperControl::ON | HelperControl::RESET_ONCE);
        axis.on = false;
        self.run(&HelperStateSet { motor: number, state: DriveState::SwitchOnDisabled })?;
        self.run(&HelperControlSet { motor: number, control, motors, slave })?;
        self.wait_for(motor, DriveState::SwitchOnDisabled)
    }

    /// The state of an axis that the helper leads; `None`: its statusword stands for none.
    ///
    /// # Errors
    /// [`XfError::Chip`], [`XfError::Link`].
    pub fn axis_state(&mut self, motor: u8) -> Result<Option<DriveState>, XfError> {
        Ok(self.run(&HelperStateGet { motor: number(motor)? })?.state())
    }

    fn lead(&mut self, motor: u8, state: DriveState) -> Result<(), XfError> {
        let number = number(motor)?;
        let axis = self.axes.iter_mut().find(|axis| axis.motor == number).ok_or(XfError::NoAxis { motor })?;
        // From the request on: its answer may be lost.
        axis.on |= state == DriveState::OperationEnabled;
        self.moves = true;
        self.run(&HelperStateSet { motor: number, state })?;
        self.wait_for(motor, state)?;
        if state == DriveState::SwitchOnDisabled {
            self.axes.iter_mut().filter(|axis| axis.motor == number).for_each(|axis| axis.on = false);
        }
        Ok(())
    }

    fn wait_for(&mut self, motor: u8, state: DriveState) -> Result<(), XfError> {
        self.wait_axis(motor, state, AXIS_LIMIT, |found| found == Some(state))
    }

    /// Waits until an axis is in a state that `is_there` takes, on its way to `wanted`.
    pub(super) fn wait_axis(
        &mut self,
        motor: u8,
        wanted: DriveState,
        limit: Duration,
        is_there: impl Fn(Option<DriveState>) -> bool,
    ) -> Result<(), XfError> {
        let begin: Ns = self.link.now();
        loop {
            let found = self.axis_state(motor)?;
            if is_there(found) {
                return Ok(());
            }
            let waited = Duration::from_nanos(self.link.now() - begin);
            if waited > limit {
                let found = found.map_or("no state", DriveState::name);
                return Err(XfError::AxisStuck { motor, found, wanted: wanted.name(), waited });
            }
        }
    }
}

fn number(motor: u8) -> Result<MotorNumber, XfError> {
    Ok(MotorNumber::decode(motor)?)
}
