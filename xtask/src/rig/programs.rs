//! Builds the programs that run in the guest: the wire tests with the programs that they start (the tool, and unchanged
//! programs with two variants of the library), or the bench of the wires.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;

use super::packages::{self, Packages};
use crate::error::Error;
use crate::project::Project;
use crate::{command, stage};

/// The group of tests that runs only in the guest.
const TESTS: &str = "rig";
/// The folders of the example programs in C and C++, which their Makefiles build. The wire tests run them as programs of
/// users.
const EXAMPLES: [&str; 2] = ["examples/c", "examples/cpp"];
/// The bench that runs only in the guest.
const BENCH: &str = "rig";
/// The SONAME of the library, under which programs load it.
pub const LIBRARY: &str = "libNEXTWUSBLib.so.0";

/// The programs and libraries for the guest, with their names below `/rig`.
pub type Programs = Vec<(String, PathBuf)>;

/// A line of cargo's output with `--message-format=json-render-diagnostics`.
#[derive(Deserialize)]
struct Message {
    target: Option<Target>,
    executable: Option<PathBuf>,
}

#[derive(Deserialize)]
struct Target {
    name: String,
    kind: Vec<String>,
}

/// Builds the wire tests and all programs that they start.
pub fn tests(project: &Project, packages: &Packages, folder: &Path) -> Result<Programs, Error> {
    let prefix = stage::build_for_tests(project)?;
    let built = folder.join("built");
    packages::empty(&built)?;
    let mut programs = vec![
        ("tests".to_owned(), build_test(project, TESTS)?),
        ("ecmsk".to_owned(), prefix.join("bin/ecmsk")),
        // The library of this project, and a library with the same functions that only reads and writes a hidraw device.
        // Tests compare what programs do with either.
        (format!("ours/{LIBRARY}"), prefix.join("lib").join(LIBRARY)),
        (format!("hidraw/{LIBRARY}"), build_hidraw_library(project, &built)?),
        ("cancelled".to_owned(), build_cancelled(project, &prefix, &built)?),
        ("usbip".to_owned(), packages.root.join("usr/sbin/usbip")),
    ];
    // The example programs, which link the library as a user's program does.
    for program in build_examples(project, &prefix, &built.join("examples"))? {
        let name = program.file_name().unwrap_or_default().to_string_lossy().into_owned();
        programs.push((format!("examples/{name}"), program));
    }
    Ok(programs)
}

/// Builds the bench of the wires.
pub fn bench(project: &Project) -> Result<Programs, Error> {
    let mut cargo = project.cargo();
    cargo.args(["bench", "--package=ecmsk", "--bench", BENCH]);
    Ok(vec![("bench".to_owned(), built(cargo, "bench", BENCH)?)])
}

/// Builds a group of tests of the root package.
pub fn build_test(project: &Project, name: &str) -> Result<PathBuf, Error> {
    built(project.cargo_as_in_tests("test", name, &[]), "test", name)
}

/// Runs this cargo command; returns the path of the program that it has built for the target `name`.
fn built(mut cargo: Command, kind: &str, name: &str) -> Result<PathBuf, Error> {
    cargo.args(["--no-run", "--message-format=json-render-diagnostics"]);
    let said = command::output(&mut cargo)?;
    let built = executable(&said, name, kind);
    built.ok_or_else(|| Error::Failed { command: command::shown(&cargo), status: "it built no program".into() })
}

fn build_examples(project: &Project, prefix: &Path, to: &Path) -> Result<Vec<PathBuf>, Error> {
    for folder in EXAMPLES {
        let mut make = Command::new("make");
        make.current_dir(project.root.join(folder)).env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"));
        command::run(make.arg("--quiet").arg(format!("OUT={}", to.display())))?;
    }
    let mut programs = fs::read_dir(to)
        .and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>, _>>())
        .map_err(Error::file("read", to))?;
    programs.sort();
    Ok(programs)
}

/// Builds a test program that cancels threads (`pthread_cancel`) during calls of the library, as a user's program may do.
fn build_cancelled(project: &Project, prefix: &Path, built: &Path) -> Result<PathBuf, Error> {
    let program = built.join("cancelled");
    let mut gcc = Command::new("gcc");
    gcc.args(["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror"]).arg("-I").arg(prefix.join("include"));
    gcc.arg("-o").args([&program, &project.root.join("tests/c/cancelled.c")]);
    command::run(gcc.arg("-L").arg(prefix.join("lib")).args(["-lNEXTWUSBLib", "-pthread"]))?;
    Ok(program)
}

fn build_hidraw_library(project: &Project, built: &Path) -> Result<PathBuf, Error> {
    let library = built.join(LIBRARY);
    let mut gcc = Command::new("gcc");
    gcc.args(["-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]).arg(format!("-Wl,-soname,{LIBRARY}"));
    command::run(gcc.arg("-o").args([&library, &project.root.join("tests/rig/hidraw_library.c")]))?;
    Ok(library)
}

fn executable(said: &[u8], name: &str, kind: &str) -> Option<PathBuf> {
    let lines = said.split(|byte| *byte == b'\n');
    let messages = lines.filter_map(|line| serde_json::from_slice::<Message>(line).ok());
    let wanted = |target: &Target| target.name == name && target.kind.iter().any(|other| other == kind);
    messages.filter(|message| message.target.as_ref().is_some_and(wanted)).find_map(|message| message.executable)
}

/// Copies a program without its debug information, which is most of its size.
pub fn stripped(program: &Path, to: &Path) -> Result<(), Error> {
    command::run(Command::new("strip").arg("-o").args([to, program]))
}

/// The paths of the shared libraries that a program loads, on this machine.
pub fn libraries(program: &Path) -> Result<Vec<PathBuf>, Error> {
    let mut ldd = Command::new("ldd");
    let said = command::output(ldd.arg(program))?;
    // NEXTWUSBLib itself is left out, because the guest has it in folders of its own (`ours/`, `hidraw/`).
    let libraries = String::from_utf8_lossy(&said).lines().filter_map(library).map(PathBuf::from).collect::<Vec<_>>();
    Ok(libraries.into_iter().filter(|path| path.file_name() != Some(OsStr::new(LIBRARY))).collect())
}

/// The path in a line of ldd: `name => /path (address)` or `/path (address)`.
fn library(line: &str) -> Option<&str> {
    line.split_whitespace().find(|word| Path::new(OsStr::new(word)).is_absolute())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_of_a_target_is_found_among_the_messages() {
        let said = br#"{"reason":"compiler-artifact","target":{"name":"rig","kind":["lib"]},"executable":null}
no json
{"reason":"compiler-artifact","target":{"name":"rig","kind":["test"]},"executable":"/t/rig-1"}
{"reason":"build-finished","success":true}"#;
        assert_eq!(executable(said, "rig", "test"), Some("/t/rig-1".into()));
        assert_eq!(executable(said, "rig", "bin"), None);
    }

    #[test]
    fn libraries_are_the_paths_that_ldd_prints() {
        assert_eq!(library("\tlibc.so.6 => /lib/libc.so.6 (0x00007f)"), Some("/lib/libc.so.6"));
        assert_eq!(library("\t/lib64/ld-linux-x86-64.so.2 (0x00007f)"), Some("/lib64/ld-linux-x86-64.so.2"));
        assert_eq!(library("\tlinux-vdso.so.1 (0x00007f)"), None);
    }
}
