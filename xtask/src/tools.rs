//! Builds programs from crates of crates.io, in a fixed version, into the target folder, so that nothing is installed
//! for other projects.

use std::path::PathBuf;

use crate::command;
use crate::error::Error;
use crate::fetched;
use crate::project::Project;

/// A crate with a program that has the name of the crate.
#[derive(Debug, PartialEq, Eq)]
pub struct Tool {
    pub name: &'static str,
    pub version: &'static str,
    /// The cost of building, for the user.
    pub cost: &'static str,
}

/// The check for dependencies that no source names.
pub const CARGO_MACHETE: Tool = Tool { name: "cargo-machete", version: "0.9.2", cost: "half a minute to build" };
/// The check of the licences, sources and known vulnerabilities of dependencies.
pub const CARGO_DENY: Tool = Tool { name: "cargo-deny", version: "0.20.2", cost: "some minutes to build" };
/// The comparison of the public API with that of an earlier version.
pub const CARGO_SEMVER_CHECKS: Tool =
    Tool { name: "cargo-semver-checks", version: "0.51.0", cost: "some minutes to build" };

impl Tool {
    /// The path of the program after building.
    pub fn program(&self, project: &Project) -> PathBuf {
        self.folder(project).join("bin").join(self.name)
    }

    pub fn is_there(&self, project: &Project) -> bool {
        self.program(project).is_file()
    }

    /// Builds the program, optimised for a short build rather than a fast program.
    pub fn install(&self, project: &Project) -> Result<(), Error> {
        println!("building {} {} ({})", self.name, self.version, self.cost);
        let build = self.folder(project).with_extension("build");
        let mut cargo = project.cargo();
        cargo.args(["install", "--locked", "--quiet", "--debug", "--root"]).arg(self.folder(project));
        cargo.arg("--target-dir").arg(&build).arg(format!("{}@{}", self.name, self.version));
        cargo.env("CARGO_PROFILE_DEV_DEBUG", "0").env("CARGO_PROFILE_DEV_OPT_LEVEL", "0");
        cargo.env_remove("CARGO_TARGET_DIR");
        command::run(&mut cargo)?;
        fetched::remove(&build)
    }

    fn folder(&self, project: &Project) -> PathBuf {
        // The version contains dots. With the extension `.d` the folder for building can be named by replacing the
        // extension; without it the last part of the version would be replaced.
        project.target.join("xtask/tools").join(format!("{}-{}.d", self.name, self.version))
    }
}
