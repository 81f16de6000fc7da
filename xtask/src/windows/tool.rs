//! The tool `ecmsk` for Windows.

use std::fs;
use std::path::Path;

use super::dll::{self, PROFILE};
use super::version::{self, Kind};
use super::{Width, folder, relocations};
use crate::command;
use crate::error::Error;
use crate::project::Project;

/// Its file.
pub const TOOL: &str = "ecmsk.exe";
const DETAILS: version::File = version::File { name: TOOL, description: "Tool for ECM-SK boards", kind: Kind::Program };

/// Builds the tool of one width into `place`.
pub fn build(project: &Project, width: Width, place: &Path) -> Result<(), Error> {
    let target = folder(project).join("build");
    let mut cargo = dll::cargo(project, width, &target)?;
    cargo.args(["rustc", "--package=ecmsk", "--bin=ecmsk", "--profile", PROFILE]);
    println!("building {TOOL} for {}", width.name());
    cargo.args(["-Zbuild-std=std,panic_abort", "--target", width.target()]);
    command::run(cargo.arg("--").arg(dll::linked(&DETAILS.object(width, &target.join(width.name()))?)))?;
    let built = target.join(width.target()).join(PROFILE).join(TOOL);
    let mut tool = fs::read(&built).map_err(Error::file("read", &built))?;
    relocations::mend(&mut tool).map_err(|what| Error::Dll { path: built, what })?;
    let to = place.join(TOOL);
    fs::write(&to, tool).map_err(Error::file("write", &to))
}
