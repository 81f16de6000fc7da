//! A machine with Windows.

use std::path::Path;

use ecmsk::link::uri::LinkUri;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::Finding;

use super::CliError;

// There is nothing to say. (A comment for rustdoc would be the verb's help.)
#[derive(clap::Args)]
pub struct SystemArgs {}

/// Nothing else can be asked for.
pub fn is_done(_: &SystemArgs) -> Result<bool, CliError> {
    Ok(false)
}

/// Folders have no other place.
pub fn root(_: &SystemArgs) -> &Path {
    Path::new("")
}

/// The system.
pub fn name(_: &SystemArgs) -> Option<String> {
    let width = if cfg!(target_pointer_width = "64") { "64-bit" } else { "32-bit" };
    Some(format!("Windows, this tool is {width}"))
}

/// All that can be told without waiting.
pub fn findings(_: &SystemArgs, wanted: Option<&LinkUri>) -> Vec<Finding> {
    Machine::here().findings(wanted)
}
