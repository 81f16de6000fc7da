//! Checks the packages with lintian.

use std::path::PathBuf;
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::needs::LINTIAN;

/// Errors and warnings end the chore; a warning that is wrong is overridden in the package, with its reason.
pub fn check(packages: &[PathBuf]) -> Result<(), Error> {
    let mut lintian = Command::new(LINTIAN.program);
    // The user's configuration is not used.
    lintian.args(["--no-cfg", "--profile", "debian", "--fail-on", "error,warning", "--info", "--"]);
    command::run(lintian.args(packages))
}
