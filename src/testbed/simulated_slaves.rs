//! Simulated slaves from a list in the syntax of `slaves=`, and their script of events, for a network without a board.

use std::path::Path;

use super::build;
use super::script::{RunningScript, Script};
use crate::address::slaves::SlaveSpec;
use crate::engine::BoardHandle;
use crate::fieldbus::Ns;
pub use crate::link::machine_error::SimulatedSlavesError;
use crate::slave::Slave;
use crate::slave::cable::Cable;

/// Builds the listed slaves in network order, each in its power-on state.
///
/// # Errors
/// [`SimulatedSlavesError::Objects`] if a file of manufacturer-specific objects cannot be used.
pub fn build(slaves: &[SlaveSpec]) -> Result<Vec<Box<dyn Slave>>, SimulatedSlavesError> {
    Ok(build::slaves(slaves)?)
}

/// Reads the script file `path` for a network of these slaves. A line that affects a board is an error.
///
/// # Errors
/// [`SimulatedSlavesError`] if the file cannot be read, a line is invalid, or a line affects a board.
pub fn script(path: &Path, slaves: &[SlaveSpec]) -> Result<Script, SimulatedSlavesError> {
    without_board(path, Script::load_for_network(path, slaves)?)
}

/// Reads the script file `path` for slaves behind a chip. All times count from the opening of the link. If the chip calls the
/// models of the slaves without EtherCAT frames (`has_frames` is false), a line that affects frames is an error.
///
/// # Errors
/// [`SimulatedSlavesError`] if the file cannot be read, a line is invalid, or a line affects a board.
pub(crate) fn script_of_chip(
    path: &Path,
    slaves: &[SlaveSpec],
    has_frames: bool,
) -> Result<Script, SimulatedSlavesError> {
    without_board(path, Script::load_for(path, slaves, has_frames)?)
}

/// Returns the script unless one of its lines affects a board.
fn without_board(path: &Path, script: Script) -> Result<Script, SimulatedSlavesError> {
    match script.of_board() {
        Some((line, verb)) => Err(SimulatedSlavesError::NoBoard { file: path.display().to_string(), line, verb }),
        None => Ok(script),
    }
}

/// Starts a script of a network without a board; its times count from `now`.
pub fn start(script: Script, network: Cable, now: Ns) -> RunningScript {
    script.start(network, BoardHandle::default(), now)
}
