//! The folders of the project, and cargo.

use std::env;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::command;
use crate::error::Error;

/// The checkout of the project on which `cargo xtask` works.
#[derive(Clone)]
pub struct Project {
    /// The root of the workspace.
    pub root: PathBuf,
    /// The target folder of cargo.
    pub target: PathBuf,
    /// Whether cargo builds for a run of all tests. The tests take longer than the builds, so code is a little optimised.
    /// Builds are not incremental, because that would double their disk space, and backtraces have no line numbers.
    pub for_tests: bool,
    /// Whether packages and the files for Windows are built only for tests: little or not optimised, which takes half of
    /// the time of a release build.
    pub quick: bool,
}

#[derive(Deserialize)]
struct Metadata {
    workspace_root: PathBuf,
    target_directory: PathBuf,
}

/// The output of `cargo metadata`, called with one more `option`. Fields that `T` does not have are ignored.
pub fn metadata<T: DeserializeOwned>(mut cargo: Command, option: &str) -> Result<T, Error> {
    let answer = command::output(cargo.args(["metadata", "--format-version=1", option]))?;
    serde_json::from_slice(&answer).map_err(|source| Error::Output { command: command::shown(&cargo), source })
}

impl Project {
    /// Finds the workspace around the current directory.
    pub fn find() -> Result<Self, Error> {
        let metadata: Metadata = metadata(Command::new(cargo_program()), "--no-deps")?;
        Ok(Self { root: metadata.workspace_root, target: metadata.target_directory, for_tests: false, quick: false })
    }

    /// The same checkout, with the builds of `cargo xtask test --all`.
    pub fn quick_for_tests(&self) -> Self {
        Self { for_tests: true, quick: true, ..self.clone() }
    }

    /// The option for the level of compression of archives, as gzip and zip have it.
    pub const fn archive_level(&self) -> &'static str {
        if self.quick { "-1" } else { "-9" }
    }

    /// cargo, run at the root of the project.
    pub fn cargo(&self) -> Command {
        self.program(cargo_program())
    }

    /// cargo with `command` for the parts of the workspace that `arguments` name, and for one group of tests. The group is
    /// there so that everything has the features that it has in `cargo test --workspace`, and is compiled once for all
    /// parts of the test.
    pub fn cargo_as_in_tests(&self, command: &str, group: &str, arguments: &[&str]) -> Command {
        let mut cargo = self.cargo();
        cargo.args([command, "--workspace", "--test", group]).args(arguments);
        cargo
    }

    /// A program that may start cargo, run at the root of the project.
    pub fn program(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        // `cargo xtask` sets these variables for this package. Build scripts that depend on them (that of ring does)
        // would run again, and everything that depends on those would be compiled again, both now and the next time
        // without this program.
        let told = env::vars_os().map(|(name, _)| name.to_string_lossy().into_owned());
        for name in told.filter(|name| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_")) {
            command.env_remove(name);
        }
        if self.for_tests {
            command.env("CARGO_INCREMENTAL", "0");
            command.env("CARGO_PROFILE_DEV_DEBUG", "0").env("CARGO_PROFILE_DEV_OPT_LEVEL", "1");
        }
        command.current_dir(&self.root);
        command
    }

    /// `path` relative to the root.
    pub fn relative<'a>(&self, path: &'a Path) -> &'a Path {
        path.strip_prefix(&self.root).unwrap_or(path)
    }
}

/// The home folder of cargo.
pub fn cargo_home() -> Option<PathBuf> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    home.or_else(|| env::var_os("HOME").map(|home| Path::new(&home).join(".cargo")))
}

/// The cargo that runs this program, so that `cargo +toolchain xtask` uses the same toolchain.
fn cargo_program() -> OsString {
    env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}
