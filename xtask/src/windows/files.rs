//! Builds the DLL and the tool for either width, with their version resources.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::version::{self, Kind};
use super::{Width, folder, relocations};
use crate::command;
use crate::debian_rust::{self, RUSTC};
use crate::error::Error;
use crate::project::{Project, cargo_home};

/// The file name of the library.
pub const DLL: &str = "NEXTWUSBLib.dll";
/// The file name of the tool.
pub const TOOL: &str = "ecmsk.exe";

/// A DLL or program for Windows that this module builds.
pub struct Built {
    details: version::File,
    /// The arguments of `cargo rustc` that select what is built.
    what: &'static [&'static str],
}

/// The library and the tool.
pub const BUILT: [Built; 2] = [
    Built {
        details: version::File {
            name: DLL,
            description: "The ECM-SK's library, of the project ecmsk",
            kind: Kind::Library,
        },
        // The DLL only, without the static library and the crate that the bench links.
        what: &["--package=NEXTWUSBLib", "--lib", "--crate-type=cdylib"],
    },
    Built {
        details: version::File { name: TOOL, description: "Tool for ECM-SK boards", kind: Kind::Program },
        what: &["--package=ecmsk-tool", "--bin=ecmsk"],
    },
];

/// The module of the Python package.
pub const MODULE: Built = Built {
    details: version::File {
        name: "ecmsk_python.dll",
        description: "The ECM-SK's module for Python, of the project ecmsk",
        kind: Kind::Library,
    },
    what: &["--package=ecmsk-python", "--lib"],
};

/// The cargo profile with which the files are built, and (next constant) the one for tests alone.
const PROFILE: &str = "windows";
const QUICK_PROFILE: &str = "windows-quick";
/// Object files that MinGW's 32-bit programs and DLLs need as their first and last ones. They register the tables for
/// unwinding. Rust's standard library has their sources, but its build does not make them.
const START_AND_END: [&str; 2] = ["rsbegin", "rsend"];

impl Built {
    /// Builds the DLL or program for a width into the folder `place`; returns its path.
    pub fn build(&self, project: &Project, width: Width, place: &Path) -> Result<PathBuf, Error> {
        let Self { details, what } = self;
        let target = folder(project).join("build");
        let shown = details.object(width, &target.join(width.name()))?;
        let mut cargo = cargo(project, width, &target)?;
        let profile = if project.quick { QUICK_PROFILE } else { PROFILE };
        cargo.arg("rustc").args(*what).args(["--profile", profile]);
        if project.quick {
            // Both the DLL and the tool use the library. With the features of both it is compiled only once.
            cargo.arg("-Zfeature-unification").env("CARGO_RESOLVER_FEATURE_UNIFICATION", "workspace");
        }
        // This leaves rustc's metadata of a crate in a file beside the library, and not a second time in it: 400 MB less.
        cargo.args([debian_rust::BUILD_STD, "-Zno-embed-metadata", "--target", width.target()]);
        println!("building {} for {}", details.name, width.name());
        cargo.arg("--").arg(format!("-Clink-arg={}", shown.display()));
        if width == Width::X86 && matches!(details.kind, Kind::Library) {
            let object = unwinding(&target)?;
            cargo.arg(format!("-Zpre-link-arg={}", object.display()));
        }
        command::run(&mut cargo)?;
        let built = target.join(width.target()).join(profile).join(details.name);
        let mut image = fs::read(&built).map_err(Error::file("read", &built))?;
        relocations::mend(&mut image).map_err(|what| Error::Dll { path: built, what })?;
        let to = place.join(details.name);
        fs::write(&to, image).map_err(Error::file("write", &to))?;
        Ok(to)
    }
}

/// cargo with the settings for a width, without its subcommand and arguments.
fn cargo(project: &Project, width: Width, target: &Path) -> Result<Command, Error> {
    let mut flags = vec![
        // Thread-local values are managed by the loader, which releases them with the DLL. Otherwise each would take
        // one of the process's 1088 TLS indexes forever whenever a program loads the DLL.
        "-Zhas-thread-local=yes".to_owned(),
    ];
    // The file must not contain paths of this machine.
    let target = in_order(target);
    for (folder, name) in
        [(Some(project.root.clone()), "ecmsk"), (cargo_home(), "cargo"), (Some(target.clone()), "target")]
    {
        flags.extend(folder.map(|folder| format!("--remap-path-prefix={}={name}", folder.display())));
    }
    if width == Width::X86 {
        flags.push(format!("-Lnative={}", start_and_end(&target)?.display()));
    }
    let mut cargo = debian_rust::cargo(project, &target, width.target(), width.mingw());
    cargo.env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1F"));
    // For ld: the files contain no time, so that linking again gives the same bytes.
    cargo.env("SOURCE_DATE_EPOCH", "0");
    Ok(cargo)
}

/// Another path of the folder, which comes before `/usr` in the alphabet wherever the folder is. GNU ld sorts imports by
/// the paths of their archives. Some archives are built in this folder and MinGW's are in `/usr`, so the order does not
/// depend on the folder.
fn in_order(folder: &Path) -> PathBuf {
    Path::new("/proc/self/root").join(folder.strip_prefix("/").unwrap_or(folder))
}

/// Compiles the functions for threads (one-time calls and mutexes) that the unwinder of 32-bit DLLs calls, so that the DLL does
/// not contain those of MinGW's winpthreads.
fn unwinding(target: &Path) -> Result<PathBuf, Error> {
    let (source, object) = (target.join("unwinding.c"), target.join("unwinding.o"));
    fs::write(&source, include_str!("unwinding.c")).map_err(Error::file("write", &source))?;
    let mut compiler = Command::new(format!("{}-gcc", Width::X86.mingw()));
    // SRW locks exist from Windows 7 on.
    compiler
        .args(["-O2", "-Wall", "-Wextra", "-Werror", "-D_WIN32_WINNT=0x0601", "-c"])
        .arg(source)
        .arg("-o")
        .arg(&object);
    command::run(&mut compiler)?;
    Ok(object)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever folder the archives of the DLL are built in, ld sorts them before those of MinGW, so that the DLL has the
    /// same bytes.
    #[test]
    fn folders_come_in_one_order() {
        for folder in ["/work/a", "/home/a", "/tmp/a", "/var/a", "/usr/local/src/a"] {
            let named = in_order(Path::new(folder));
            assert!(named.to_str() < Some("/usr") && named.ends_with(&folder[1..]), "{}", named.display());
        }
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        assert_eq!(in_order(here).canonicalize().unwrap(), here.canonicalize().unwrap());
    }
}
