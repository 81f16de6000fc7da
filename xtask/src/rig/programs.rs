//! What runs in the guest: the tool, and the wire tests as one program.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;

use crate::command;
use crate::error::Error;
use crate::project::Project;

/// The test of the root package that runs in the guest alone.
const TESTS: &str = "rig";

/// Programs that were built for the guest.
pub struct Programs {
    pub tool: PathBuf,
    pub tests: PathBuf,
}

/// A line of cargo's `--message-format=json`.
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

/// Builds both.
pub fn build(project: &Project) -> Result<Programs, Error> {
    let mut cargo = project.cargo();
    cargo.args(["test", "--package=ecmsk", "--bin=ecmsk", "--test", TESTS, "--no-run", "--message-format=json"]);
    let said = command::output(&mut cargo)?;
    let tests = executable(&said, TESTS, "test");
    // The tests of a package bring its programs, as users have them.
    let tool = project.target.join("debug/ecmsk");
    match tests {
        Some(tests) if tool.is_file() => Ok(Programs { tool, tests }),
        _ => Err(Error::Failed { command: command::shown(&cargo), status: "it built no tests".into() }),
    }
}

fn executable(said: &[u8], name: &str, kind: &str) -> Option<PathBuf> {
    let lines = said.split(|byte| *byte == b'\n');
    let messages = lines.filter_map(|line| serde_json::from_slice::<Message>(line).ok());
    let wanted = |target: &Target| target.name == name && target.kind.iter().any(|other| other == kind);
    messages.filter(|message| message.target.as_ref().is_some_and(wanted)).find_map(|message| message.executable)
}

/// The program without what only a debugger needs, which is most of it.
pub fn stripped(program: &Path, to: &Path) -> Result<(), Error> {
    command::run(Command::new("strip").arg("-o").args([to, program]))
}

/// The libraries that a program loads, by their places on this machine.
pub fn libraries(program: &Path) -> Result<Vec<PathBuf>, Error> {
    let mut ldd = Command::new("ldd");
    let said = command::output(ldd.arg(program))?;
    Ok(String::from_utf8_lossy(&said).lines().filter_map(library).map(PathBuf::from).collect())
}

/// `name => /path (address)` or `/path (address)`.
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
