//! `servo`: switches axes on and off, and clears alarms.

use clap::ValueEnum;
use ecmsk::cia402::DriveState;
use ecmsk::ecm::Config;
use serde_json::json;

use crate::board::{Board, BoardError, Needs, SlaveList, Units, statusword_text};

/// Switch axes on or off, or clear their alarms
///
/// An axis that is switched off without a brake drops if it hangs. All axes of the list change in the same cycle.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// What to do with the axes
    #[arg(value_enum)]
    verb: What,
    /// The axes, by the numbers of their slaves or by their names in the machine file, e.g. 1,2 or all
    #[arg(value_name = "AXES", required = true, value_parser = SlaveList::parse)]
    axes: Vec<SlaveList>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum What {
    /// Switch to Operation enabled: the motor holds its position
    On,
    /// Leave Operation enabled: the motor is free
    Off,
    /// Reset alarms; the axes are off afterwards
    Clear,
}

impl What {
    const fn name(self) -> &'static str {
        match self {
            Self::On => "servo on",
            Self::Off => "servo off",
            Self::Clear => "servo clear",
        }
    }
}

impl Args {
    /// Checks the axes before anything is sent.
    ///
    /// # Errors
    /// A slave does not exist or has no axis.
    pub fn check(&self, network: &Config, units: Units<'_>) -> Result<(), BoardError> {
        SlaveList::axes(&self.axes, network, self.verb.name(), units).map(|_| ())
    }

    /// Switches the axes on or off, or clears their alarms, and prints their states.
    ///
    /// # Errors
    /// [`BoardError`] if a slave does not exist or has no axis, the network is not in OP, a drive does not reach the state
    /// in time, or a signal stops the step.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        let what = self.verb.name();
        board.ready(what, Needs::Op)?;
        let axes = SlaveList::axes(&self.axes, board.known_network(what)?, what, board.units())?;
        let axes: Vec<u8> = axes.into_iter().map(|(slave, _)| slave).collect();
        board.forget_targets();
        board.run_interruptible(what, |ecm| match self.verb {
            What::On => ecm.servo_on(&axes),
            What::Off => ecm.servo_off(&axes),
            What::Clear => ecm.clear_alarm(&axes),
        })?;
        let snapshot = board.ecm.snapshot()?;
        for slave in axes {
            let word = board.statusword(&snapshot, slave);
            let state = word.state();
            // In CiA 402 the state "Switched on" means that the motor is free. So the text says only whether the motor
            // has torque, which is the case in Operation enabled.
            let is_on = state == Some(DriveState::OperationEnabled);
            let motor = if is_on { "on" } else { "off" };
            let state = state.map(|state| state.name());
            let mut json = json!({"verb": what, "axis": slave, "on": is_on, "state": state, "statusword": word.0});
            board.add_names(slave, &mut json);
            let label = board.label(slave);
            board.reporter.result(format_args!("axis {label}: {motor}, {}", statusword_text(word)), &json)?;
        }
        Ok(())
    }
}
