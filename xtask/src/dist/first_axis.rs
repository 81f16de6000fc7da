//! Does what the user of a package does first: puts it in place without a network, and moves a simulated axis. Tells how long
//! this takes.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use crate::command;
use crate::error::Error;

/// The tool's arguments that move a simulated axis.
pub const MOVE: [&str; 5] = ["move", "1=1000", "--up", "--link", "sim:?slaves=drive&clock=virtual"];
/// What the tool prints then.
pub const MOVED: &str = "axis 1: at 1000\n";

/// Runs `work`, which puts a package in place, moves axes and returns what was printed. Tells the time that it took.
///
/// # Errors
/// The axes are not where they should be: `moved` is not printed.
pub fn timed(package: &str, moved: &str, work: impl FnOnce() -> Result<String, Error>) -> Result<(), Error> {
    let began = Instant::now();
    let said = work()?;
    if !said.contains(moved) {
        return Err(Error::Package(format!("with {package} no axis moves: {said:?} was printed, without {moved:?}")));
    }
    println!("{package}: put in place and an axis moved in {:.1} s", began.elapsed().as_secs_f64());
    Ok(())
}

/// Unpacks the `.tar.gz` package into the folder `work`, and moves an axis with its tool.
pub fn of_the_tarball(tar: &Path, work: &Path) -> Result<(), Error> {
    std::fs::create_dir_all(work).map_err(Error::file("make", work))?;
    timed("the tar.gz file", MOVED, || {
        command::output(Command::new("tar").arg("--extract").arg("--file").arg(tar).arg("--directory").arg(work))?;
        let top = tar.file_name().unwrap_or_default().to_string_lossy();
        let tool = work.join(top.trim_end_matches(".tar.gz")).join("bin/ecmsk");
        let said = command::output(Command::new(tool).env_remove("ECMSK_LINK").args(MOVE))?;
        Ok(String::from_utf8_lossy(&said).into_owned())
    })
}
