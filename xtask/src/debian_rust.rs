//! Debian's Rust compiler, for targets for which the project's toolchain has no standard library: that of Windows 7, and those
//! of small computers. The standard library is built from its sources for them.

use std::path::Path;
use std::process::Command;

use crate::project::Project;

/// Debian's cargo and rustc by their full paths, because rustup puts its own programs before them in PATH.
const CARGO: &str = "/usr/bin/cargo";
pub const RUSTC: &str = "/usr/bin/rustc";

/// The option with which cargo also builds the standard library, from its sources.
pub const BUILD_STD: &str = "-Zbuild-std=std,panic_abort";

/// cargo for the target `triple`, whose C programs begin with the prefix `gnu`, without its subcommand and arguments. It builds
/// in the folder `target`.
pub fn cargo(project: &Project, target: &Path, triple: &str, gnu: &str) -> Command {
    let mut cargo = Command::new(CARGO);
    cargo.current_dir(&project.root);
    // Otherwise rustup's rustc would be found first, with which this program runs.
    cargo.env("RUSTC", RUSTC).env("PATH", "/usr/bin:/bin").env_remove("RUSTUP_TOOLCHAIN");
    // A stable compiler builds the standard library only with this variable.
    cargo.env("RUSTC_BOOTSTRAP", "1").env("CARGO_TARGET_DIR", target).env_remove("RUSTFLAGS");
    let variable = triple.replace('-', "_");
    cargo.env(format!("CC_{variable}"), format!("{gnu}-gcc")).env(format!("AR_{variable}"), format!("{gnu}-ar"));
    cargo
}
