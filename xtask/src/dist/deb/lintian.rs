//! Checks the packages with lintian.

use std::path::PathBuf;
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::needs::LINTIAN;

/// Runs lintian on the packages. An error or a warning fails `cargo xtask dist`. The packages contain an override file,
/// with the reason, for a warning that does not apply.
pub fn check(packages: &[&PathBuf]) -> Result<(), Error> {
    let mut lintian = Command::new(LINTIAN.program);
    // `--no-cfg`: a lintian configuration of the user has no effect.
    lintian.args(["--no-cfg", "--profile", "debian", "--fail-on", "error,warning", "--info", "--"]);
    command::run(lintian.args(packages))
}
