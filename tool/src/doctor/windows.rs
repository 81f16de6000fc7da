//! Checks whether a Windows machine can run a board.

use std::path::Path;

use ecmsk::link::uri::LinkUri;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::Finding;

use super::CliError;

// No options on Windows. A doc comment would become the help of the verb.
#[derive(clap::Args)]
pub struct SystemArgs {}

/// Returns false: on Windows `doctor` has no option that replaces the checks.
pub fn is_done(_: &SystemArgs) -> Result<bool, CliError> {
    Ok(false)
}

/// The folder that is used as `/` on Linux; it has no meaning on Windows.
pub fn root(_: &SystemArgs) -> &Path {
    Path::new("")
}

/// The name of the operating system.
pub fn name(_: &SystemArgs) -> Option<String> {
    let width = if cfg!(target_pointer_width = "64") { "64-bit" } else { "32-bit" };
    Some(format!("Windows, this tool is {width}"))
}

/// The findings about this machine, except those that need a measurement.
pub fn findings(_: &SystemArgs, wanted: Option<&LinkUri>) -> Vec<Finding> {
    Machine::here().findings(wanted)
}

/// Always `None`, because there are no `nic:` links on Windows.
pub fn round_trip(_: &SystemArgs, _: Option<&LinkUri>, _: &[Finding]) -> Option<Finding> {
    None
}
