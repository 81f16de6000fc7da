//! `expect`: fails if the state, a position or inputs are not as expected, so that a script can check its own effect.

use clap::Subcommand;
use ecmsk::ecm::Config;
use ecmsk::sk::MasterState;

use super::io::{bits, io_slave};
use super::motion::{AxisTarget, Target};
use super::state;
use crate::board::{Board, BoardError, Needs, Units, find_slave, not_negative, whole};

const WHAT: &str = "expect";

/// Fail if the board is not as expected
#[derive(Clone, Debug, clap::Args)]
#[command(disable_help_subcommand = true, arg_required_else_help = true)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Clone, Debug, Subcommand)]
enum Verb {
    /// The network must be in this state
    State {
        #[arg(value_name = "init|preop|safeop|op", value_parser = state::parse)]
        state: MasterState,
    },
    /// Axes must be at these positions: counts, or units for axes with names or with --counts-per-unit
    Position {
        #[arg(value_name = "AXIS=POSITION", required = true, value_parser = Target::parse)]
        positions: Vec<Target>,
        /// Allowed deviation of each position, in the same units
        #[arg(long, value_name = "N", default_value = "0", value_parser = not_negative, allow_negative_numbers = true)]
        within: f64,
    },
    /// The 16 inputs of an IO slave must be exactly these, bit k is input k, e.g. 3=0x0001
    Inputs {
        #[arg(value_name = "SLAVE=BITS", value_parser = inputs)]
        inputs: (u8, u16),
    },
}

fn inputs(text: &str) -> Result<(u8, u16), String> {
    let (slave, inputs) = text.split_once('=').ok_or("allowed: SLAVE=BITS, e.g. 3=0x0001")?;
    let slave = whole(slave).and_then(|slave| u8::try_from(slave).ok()).filter(|slave| (1..=40).contains(slave));
    Ok((slave.ok_or("allowed: a slave from 1 to 40")?, bits(inputs)?))
}

impl Args {
    /// Checks the axes and slaves of the step before anything is sent.
    ///
    /// # Errors
    /// A slave does not exist or is of another kind.
    pub fn check(&self, network: &Config, units: Units<'_>) -> Result<(), BoardError> {
        match &self.verb {
            Verb::State { .. } => Ok(()),
            Verb::Position { positions, .. } => {
                let find = |position: &Target| find_slave(network, WHAT, position.resolve(WHAT, units)?.slave);
                positions.iter().try_for_each(|position| find(position).map(|_| ()))
            }
            Verb::Inputs { inputs: (slave, _) } => io_slave(network, WHAT, *slave),
        }
    }

    /// Reads the state, the positions or the inputs, and compares them with what is expected.
    ///
    /// # Errors
    /// [`BoardError`] if they differ, if a slave does not exist or is of another kind, if the network is not in OP for
    /// positions or inputs, or if the board does not answer.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        let failed = |why| BoardError::Refused { what: WHAT.into(), why, next: "see what came before".into() };
        match &self.verb {
            Verb::State { state } => {
                let found = board.ecm.state()?;
                let is_it = found.state() == Some(*state) && !found.is_failed();
                if is_it { Ok(()) } else { Err(failed(format!("the network is in {found}, not in {state}"))) }
            }
            Verb::Position { positions, within } => {
                board.ready(WHAT, Needs::Op)?;
                let snapshot = board.ecm.next_cycle(board.options.read_limit)?;
                for position in positions {
                    let AxisTarget { slave, value, scale, .. } = position.resolve(WHAT, board.units())?;
                    board.axis(WHAT, slave)?;
                    let found = snapshot.position(slave).map_or(f64::NAN, |position| scale.to_units(position));
                    if found.is_nan() || (found - value).abs() > *within {
                        let label = board.label(slave);
                        return Err(failed(format!("axis {label} is at {found}, not at {value} within {within}")));
                    }
                }
                Ok(())
            }
            Verb::Inputs { inputs: (slave, wanted) } => {
                board.ready(WHAT, Needs::Op)?;
                let found = board.run_interruptible("reading inputs", |ecm| ecm.inputs(*slave))?;
                let is_it = found == *wanted;
                if is_it {
                    Ok(())
                } else {
                    Err(failed(format!("inputs of slave {slave} are 0x{found:04X}, not 0x{wanted:04X}")))
                }
            }
        }
    }
}
