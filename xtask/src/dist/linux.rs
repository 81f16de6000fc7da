//! Builds the library, the tool and the module of the Python package for Linux: without debug information, and with the same
//! bytes in whatever folder they are built.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use super::machine::Machine;
use super::release::Release;
use super::wheel;
use crate::error::Error;
use crate::needs::STRIP;
use crate::project::Project;
use crate::{command, debian_rust, remapped, stage};

/// The profile of cargo with which packages are built, which is also the name of its folder below the target folder.
const PROFILE: &str = "release";

/// The file name that cargo gives to the module of the Python package.
const MODULE: &str = "libecmsk_python.so";

/// Builds the library and the tool for a machine, and installs them into `prefix` as `cargo xtask stage` does. The tool
/// writes its own manual pages and completions. `tool` is one that runs on this machine and writes them for a foreign
/// machine; `None`: the tool that was built. Also builds the [`module`] of the Python package.
pub fn build_into(
    project: &Project,
    release: &Release,
    machine: Machine,
    tool: Option<&Path>,
    prefix: &Path,
) -> Result<(), Error> {
    let target = super::folder(project).join("build");
    let wrapper = super::folder(project).join(format!("rustc-{}", machine.debian()));
    let rustc = if machine.is_foreign() { machine.rustc().into() } else { remapped::own_rustc() };
    remapped::write(project, rustc, &target, &wrapper)?;
    // If all packages are built together, the library crate is compiled only once, which is quicker. NEXTWUSBLib then also
    // contains the features that only the tool needs, so a release builds them one after the other.
    let all: Vec<&str> = stage::PACKAGES.into_iter().chain([wheel::PACKAGE]).collect();
    for packages in all.chunks(if project.quick { all.len() } else { 1 }) {
        println!("building {} for Linux on {}", packages.join(" and "), machine.debian());
        let mut cargo = machine.cargo(project, &target);
        let chosen: Vec<OsString> = cargo.get_envs().filter_map(|(name, value)| value.and(Some(name.into()))).collect();
        let inherited = env::vars_os().map(|(name, _)| name).filter(|name| is_a_setting(&name.to_string_lossy()));
        for name in inherited.filter(|name| !chosen.contains(name)) {
            cargo.env_remove(name);
        }
        cargo.env("RUSTC_WRAPPER", &wrapper);
        // Debug information would be removed anyway. The linker already removes symbols, because the build id is computed
        // from its output.
        cargo.env("CARGO_PROFILE_RELEASE_DEBUG", "false").env("CARGO_PROFILE_RELEASE_STRIP", "symbols");
        // With several codegen units in a crate, link-time optimisation generates names of symbols that depend on the folder of
        // the build, and the static library keeps them. So a release, which must be reproducible, is built with one unit; a
        // quick build for tests is not.
        let (units, level) = if project.quick { ("16", "1") } else { ("1", "3") };
        cargo.env("CARGO_PROFILE_RELEASE_CODEGEN_UNITS", units).env("CARGO_PROFILE_RELEASE_OPT_LEVEL", level);
        cargo.env(super::release::VARIABLE, release.epoch.to_string());
        cargo.args(["build", "--locked", "--profile", PROFILE]);
        if machine.is_foreign() {
            cargo.args([debian_rust::BUILD_STD, "--target", machine.target()]);
        }
        command::run(cargo.args(packages.iter().flat_map(|package| ["--package", package])))?;
    }
    if prefix.exists() {
        fs::remove_dir_all(prefix).map_err(Error::file("remove", prefix))?;
    }
    let built = if machine.is_foreign() { target.join(machine.target()) } else { target }.join(PROFILE);
    stage::install_into(project, &built, tool, prefix)?;
    let module = module(project, machine);
    fs::create_dir_all(module.parent().unwrap_or(prefix)).map_err(Error::file("make a folder for", &module))?;
    fs::copy(built.join(MODULE), &module).map_err(Error::file("copy", &module))?;
    strip(machine, &["--strip-all"], &module)?;
    let lib = Path::new("lib");
    for file in [Path::new("bin").join("ecmsk"), lib.join(stage::SONAME), lib.join(stage::SLEEP_LIBRARY)] {
        strip(machine, &["--strip-all"], &prefix.join(file))?;
    }
    strip(machine, &["--strip-debug", "--enable-deterministic-archives"], &prefix.join("lib").join(stage::ARCHIVE))
}

/// The built module of the Python package for a machine.
pub fn module(project: &Project, machine: Machine) -> PathBuf {
    super::folder(project).join("modules").join(machine.debian()).join(MODULE)
}

fn strip(machine: Machine, options: &[&str], file: &Path) -> Result<(), Error> {
    command::run(machine.gnu_program(STRIP.program).args(options).args(["--remove-section=.comment", "--"]).arg(file))
}

/// Whether an environment variable changes what cargo builds. Such variables of the user are removed, so that the build
/// does not depend on them.
fn is_a_setting(variable: &str) -> bool {
    ["CARGO_PROFILE_", "CARGO_BUILD_", "CARGO_TARGET_", "CARGO_ENCODED_", "RUSTFLAGS", "CFLAGS", "RUSTC"]
        .iter()
        .any(|begin| variable.starts_with(begin))
}
