//! Simulated slaves as `slaves=` lists them, and the script of what happens to them, for a network without a board.

use std::path::Path;

use super::manufacturer_objects::ManufacturerObjectsError;
use super::script::{RunningScript, Script, ScriptError};
use super::sim;
use super::slaves::SlaveSpec;
use crate::engine::BoardHandle;
use crate::fieldbus::Ns;
use crate::slave::Slave;
use crate::slave::cable::Cable;

/// Why slaves, or what happens to them, cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum SimulatedSlavesError {
    /// See [`ManufacturerObjectsError`].
    #[error(transparent)]
    Objects(#[from] ManufacturerObjectsError),
    /// See [`ScriptError`].
    #[error(transparent)]
    Script(#[from] ScriptError),
    /// The script does something to a board.
    #[error("{file}, line {line}: `{verb}` happens to a board, and there is none here; take the line out")]
    NoBoard { file: String, line: u32, verb: &'static str },
}

/// The slaves of the list in the order of the cable, each just switched on.
///
/// # Errors
/// [`SimulatedSlavesError::Objects`].
pub fn build(slaves: &[SlaveSpec]) -> Result<Vec<Box<dyn Slave>>, SimulatedSlavesError> {
    Ok(sim::slaves(slaves)?)
}

/// Reads the script in the file `path` for a network of these slaves. A line that happens to a board is refused.
///
/// # Errors
/// [`SimulatedSlavesError`].
pub fn script(path: &Path, slaves: &[SlaveSpec]) -> Result<Script, SimulatedSlavesError> {
    let script = Script::load_for_network(path, slaves)?;
    match script.of_board() {
        Some((line, verb)) => Err(SimulatedSlavesError::NoBoard { file: path.display().to_string(), line, verb }),
        None => Ok(script),
    }
}

/// The same for slaves behind a chip: its lines wait for nothing, and happen to frames only if there are some.
///
/// # Errors
/// [`SimulatedSlavesError`].
pub(super) fn script_of_chip(
    path: &Path,
    slaves: &[SlaveSpec],
    has_frames: bool,
) -> Result<Script, SimulatedSlavesError> {
    let script = if has_frames { Script::load(path, slaves)? } else { Script::load_for_board(path, slaves)? };
    match script.of_board() {
        Some((line, verb)) => Err(SimulatedSlavesError::NoBoard { file: path.display().to_string(), line, verb }),
        None => Ok(script),
    }
}

/// Starts a script of a network without a board; its times count from `now`.
pub fn start(script: Script, network: Cable, now: Ns) -> RunningScript {
    script.start(network, BoardHandle::default(), now)
}
