//! What stops an axis when a program ends.

use std::time::Duration;

use super::{Xf, XfError};
use crate::cia402::DriveState;
use crate::link::chip::ChipLink;
use crate::xf::EtherCatState;
use crate::xf::request::{FifoEnable, HelperStateSet, Slaves, StateSet};

/// How long axes may take to a standstill. \[OURS]
const STOP_LIMIT: Duration = Duration::from_secs(3);

impl<L: ChipLink> Xf<L> {
    /// Ends the program's work with the chip. If it has sent outputs or switched an axis on, the axes that are on make a
    /// quick stop (0x605A, 0x6085 of the drive) and are switched off, the FIFO is switched off, and the network goes to
    /// SafeOP, in which a slave's outputs have no effect. Dropping does the same, and cannot say what went wrong.
    ///
    /// Only a program that still runs can do this. If it is killed, the chip repeats the last outputs for ever: in CSP
    /// an axis stands, in CSV and CST it goes on. What has to stop then has to be stopped by the machine.
    ///
    /// # Errors
    /// The first thing that went wrong: [`XfError::AxisStuck`], [`XfError::Chip`], [`XfError::Link`]. All that could
    /// still be done was done.
    pub fn close(mut self) -> Result<(), XfError> {
        self.stop()
    }

    /// Leaves the chip, its network and its axes as they are, for a program that comes back to them.
    pub fn leave(mut self) {
        self.moves = false;
    }

    fn stop(&mut self) -> Result<(), XfError> {
        if !std::mem::take(&mut self.moves) {
            return Ok(());
        }
        let axes = std::mem::take(&mut self.axes);
        let on = || axes.iter().filter(|axis| axis.on).map(|axis| axis.motor);
        let mut result = Ok(());
        let mut note = |done: Result<(), XfError>| result = std::mem::replace(&mut result, Ok(())).and(done);
        // All axes begin to stop before any is waited for.
        for motor in on() {
            note(self.run(&HelperStateSet { motor, state: DriveState::QuickStopActive }));
        }
        for motor in on() {
            note(self.wait_off(motor.get()));
            note(self.run(&HelperStateSet { motor, state: DriveState::SwitchOnDisabled }));
        }
        note(self.run(&FifoEnable { on: false }));
        note(self.run(&StateSet { slaves: Slaves::All, state: EtherCatState::SafeOp }));
        result
    }

    /// Waits until an axis has left Operation enabled and Quick stop active.
    fn wait_off(&mut self, motor: u8) -> Result<(), XfError> {
        self.wait_axis(motor, DriveState::SwitchOnDisabled, STOP_LIMIT, |found| {
            !matches!(found, Some(DriveState::OperationEnabled | DriveState::QuickStopActive))
        })
    }
}

impl<L: ChipLink> Drop for Xf<L> {
    fn drop(&mut self) {
        // There is nobody to tell.
        let _ = self.stop();
    }
}
