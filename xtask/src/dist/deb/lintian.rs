//! Checks the packages with lintian.

use std::path::PathBuf;
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::needs::LINTIAN;

/// Runs lintian. Errors and warnings fail the chore. A warning that does not apply is overridden in the package, with the
/// reason.
pub fn check(packages: &[&PathBuf]) -> Result<(), Error> {
    let mut lintian = Command::new(LINTIAN.program);
    // `--no-cfg`: a lintian configuration of the user has no effect.
    lintian.args(["--no-cfg", "--profile", "debian", "--fail-on", "error,warning", "--info", "--"]);
    command::run(lintian.args(packages))
}
