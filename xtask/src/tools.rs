//! Programs that are built from a crate of crates.io, in a version that is known, into the target folder: nothing is installed
//! where other projects would find it.

use std::path::PathBuf;

use crate::command;
use crate::error::Error;
use crate::fetched;
use crate::project::Project;

/// A crate with a program of its name.
#[derive(Debug, PartialEq, Eq)]
pub struct Tool {
    pub name: &'static str,
    pub version: &'static str,
    /// What it costs, for the user.
    pub cost: &'static str,
}

/// Finds dependencies that no source names.
pub const CARGO_MACHETE: Tool = Tool { name: "cargo-machete", version: "0.9.2", cost: "half a minute to build" };
/// Looks at licences and sources of dependencies, and at their known weaknesses.
pub const CARGO_DENY: Tool = Tool { name: "cargo-deny", version: "0.20.2", cost: "some minutes to build" };
/// Compares what a version offers with what the one before did.
pub const CARGO_SEMVER_CHECKS: Tool =
    Tool { name: "cargo-semver-checks", version: "0.51.0", cost: "some minutes to build" };

impl Tool {
    /// The program, once it is there.
    pub fn program(&self, project: &Project) -> PathBuf {
        self.folder(project).join("bin").join(self.name)
    }

    pub fn is_there(&self, project: &Project) -> bool {
        self.program(project).is_file()
    }

    /// Builds it. How long that takes counts for more here than how fast the program is.
    pub fn install(&self, project: &Project) -> Result<(), Error> {
        println!("building {} {} ({})", self.name, self.version, self.cost);
        let build = self.folder(project).with_extension("build");
        let mut cargo = project.cargo();
        cargo.args(["install", "--locked", "--quiet", "--debug", "--root"]).arg(self.folder(project));
        cargo.arg("--target-dir").arg(&build).arg(format!("{}@{}", self.name, self.version));
        cargo.env("CARGO_PROFILE_DEV_DEBUG", "0").env_remove("CARGO_TARGET_DIR");
        command::run(&mut cargo)?;
        fetched::remove(&build)
    }

    fn folder(&self, project: &Project) -> PathBuf {
        // The version has dots: no extension of the name may be replaced.
        project.target.join("xtask/tools").join(format!("{}-{}.d", self.name, self.version))
    }
}
