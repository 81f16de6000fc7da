//! Checks a machine with Windows.

use std::path::Path;

use ecmsk::link::uri::LinkUri;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::Finding;

use super::CliError;

// No options on Windows. A doc comment would become the help of the verb.
#[derive(clap::Args)]
pub struct SystemArgs {}

/// Windows has no options beside those of every system.
pub fn is_done(_: &SystemArgs) -> Result<bool, CliError> {
    Ok(false)
}

/// Unused on Windows.
pub fn root(_: &SystemArgs) -> &Path {
    Path::new("")
}

/// The name of the system.
pub fn name(_: &SystemArgs) -> Option<String> {
    let width = if cfg!(target_pointer_width = "64") { "64-bit" } else { "32-bit" };
    Some(format!("Windows, this tool is {width}"))
}

/// All findings that need no measurement.
pub fn findings(_: &SystemArgs, wanted: Option<&LinkUri>) -> Vec<Finding> {
    Machine::here().findings(wanted)
}

/// None, because `nic:` does not exist on Windows.
pub fn round_trip(_: &SystemArgs, _: Option<&LinkUri>, _: &[Finding]) -> Option<Finding> {
    None
}
