//! The DLLs.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use super::version::{self, Kind};
use super::{Width, folder, relocations};
use crate::command;
use crate::error::Error;
use crate::project::Project;

/// The library's file.
pub const DLL: &str = "NEXTWUSBLib.dll";
const DETAILS: version::File =
    version::File { name: DLL, description: "The ECM-SK's library, of the project ecmsk", kind: Kind::Library };
/// Cargo's profile for it.
pub const PROFILE: &str = "windows";
/// Debian's programs, whatever rustup has put in front of them.
pub const CARGO: &str = "/usr/bin/cargo";
pub const RUSTC: &str = "/usr/bin/rustc";
/// Objects that MinGW's 32-bit programs and DLLs begin and end with, of the standard library's sources; building it does
/// not make them.
const START_AND_END: [&str; 2] = ["rsbegin", "rsend"];

/// Builds the DLL of one width into `place`.
pub fn build(project: &Project, width: Width, place: &Path) -> Result<(), Error> {
    let target = folder(project).join("build");
    let mut cargo = cargo(project, width, &target)?;
    // The DLL alone: not the archive, and not the crate that the bench links.
    cargo.args(["rustc", "--package=NEXTWUSBLib", "--lib", "--crate-type=cdylib", "--profile", PROFILE]);
    println!("building {DLL} for {}", width.name());
    cargo.args(["-Zbuild-std=std,panic_abort", "--target", width.target()]);
    command::run(cargo.arg("--").arg(linked(&DETAILS.object(width, &target.join(width.name()))?)))?;
    let built = target.join(width.target()).join(PROFILE).join(DLL);
    let mut dll = fs::read(&built).map_err(Error::file("read", &built))?;
    relocations::mend(&mut dll).map_err(|what| Error::Dll { path: built, what })?;
    let to = place.join(DLL);
    fs::write(&to, dll).map_err(Error::file("write", &to))
}

/// What tells rustc to link an object.
pub fn linked(object: &Path) -> String {
    format!("-Clink-arg={}", object.display())
}

/// cargo, set up for a width; its verb and arguments are to follow.
pub fn cargo(project: &Project, width: Width, target: &Path) -> Result<Command, Error> {
    let mut flags = vec![
        // Thread-local values as the loader knows them: it gives them up with the DLL. Otherwise each would take one of the
        // process's 1088 TLS indexes for good, every time that a program loads the DLL.
        "-Zhas-thread-local=yes".to_owned(),
    ];
    // No path of this machine in the file.
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| env::var_os("HOME").map(|home| Path::new(&home).join(".cargo")));
    for (folder, name) in [(Some(project.root.clone()), "ecmsk"), (home, "cargo")] {
        flags.extend(folder.map(|folder| format!("--remap-path-prefix={}={name}", folder.display())));
    }
    if width == Width::X86 {
        flags.push(format!("-Lnative={}", start_and_end(target)?.display()));
    }
    let mut cargo = Command::new(CARGO);
    cargo.current_dir(&project.root);
    // Otherwise rustup's, which runs this program, would be found first.
    cargo.env("RUSTC", RUSTC).env("PATH", "/usr/bin:/bin").env_remove("RUSTUP_TOOLCHAIN");
    // The standard library is built too, which only a nightly compiler does without being told that it may.
    cargo.env("RUSTC_BOOTSTRAP", "1").env("CARGO_TARGET_DIR", target);
    cargo.env_remove("RUSTFLAGS").env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1F"));
    // For ld: the files have no time, so that linking them again gives the same bytes.
    cargo.env("SOURCE_DATE_EPOCH", "0");
    let variable = width.target().replace('-', "_");
    cargo.env(format!("CC_{variable}"), format!("{}-gcc", width.mingw()));
    cargo.env(format!("AR_{variable}"), format!("{}-ar", width.mingw()));
    Ok(cargo)
}

fn start_and_end(target: &Path) -> Result<PathBuf, Error> {
    let folder = target.join("start-and-end");
    fs::create_dir_all(&folder).map_err(Error::file("make", &folder))?;
    let sysroot = command::output(Command::new(RUSTC).args(["--print", "sysroot"]))?;
    let sources = Path::new(String::from_utf8_lossy(&sysroot).trim()).join("lib/rustlib/src/rust/library/rtstartup");
    for name in START_AND_END {
        let mut rustc = Command::new(RUSTC);
        rustc.env("RUSTC_BOOTSTRAP", "1").args(["--target", Width::X86.target(), "--emit=obj", "-o"]);
        command::run(rustc.arg(folder.join(name).with_extension("o")).arg(sources.join(name).with_extension("rs")))?;
    }
    Ok(folder)
}
