//! Simulated slaves as `slaves=` lists them, and the script of what happens to them, for a network without a board.

use std::path::Path;

use super::build;
use super::script::{RunningScript, Script};
use crate::address::slaves::SlaveSpec;
use crate::engine::BoardHandle;
use crate::fieldbus::Ns;
pub use crate::link::machine_error::SimulatedSlavesError;
use crate::slave::Slave;
use crate::slave::cable::Cable;

/// The slaves of the list in the order of the cable, each just switched on.
///
/// # Errors
/// [`SimulatedSlavesError::Objects`].
pub fn build(slaves: &[SlaveSpec]) -> Result<Vec<Box<dyn Slave>>, SimulatedSlavesError> {
    Ok(build::slaves(slaves)?)
}

/// Reads the script in the file `path` for a network of these slaves. A line that happens to a board is refused.
///
/// # Errors
/// [`SimulatedSlavesError`].
pub fn script(path: &Path, slaves: &[SlaveSpec]) -> Result<Script, SimulatedSlavesError> {
    without_board(path, Script::load_for_network(path, slaves)?)
}

/// The same for slaves behind a chip: its lines wait for nothing, and happen to frames only if there are some.
///
/// # Errors
/// [`SimulatedSlavesError`].
pub(crate) fn script_of_chip(
    path: &Path,
    slaves: &[SlaveSpec],
    has_frames: bool,
) -> Result<Script, SimulatedSlavesError> {
    without_board(path, Script::load_for(path, slaves, has_frames)?)
}

/// The script in that file, unless a line happens to a board.
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
