//! The errors of the verbs of `cargo xtask` (chores). Most messages end with what the user can do next.

use std::io;
use std::path::{Path, PathBuf};

/// Why a verb of `cargo xtask` stopped.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error("cannot start `{command}`: {source}; is it installed and on PATH?")]
    Start { command: String, source: io::Error },
    #[error("this failed ({status}); repeat it with:\n    {command}")]
    Failed { command: String, status: String },
    #[error("cannot {doing} {}: {source}", path.display())]
    File { doing: &'static str, path: PathBuf, source: io::Error },
    #[error(
        "the output of `{command}` cannot be read ({source}); is this cargo older than the project's rust-version?"
    )]
    Output { command: String, source: serde_json::Error },
    #[error("{missing} not found; install it with:\n    {install}")]
    Missing { missing: String, install: String },
    #[error("{}:{line}: {problem}", path.display())]
    Rules { path: PathBuf, line: usize, problem: String },
    #[error("{} is no Rust that can be read ({problem}); `cargo check` says more", path.display())]
    Rust { path: PathBuf, problem: String },
    #[error("{0}")]
    Features(String),
    #[error("{0}")]
    Release(String),
    #[error(
        "`{link}` is none of sim:, xf-sim: and nic, whose slaves are simulated. The program homes two axes and moves them by \
         1,000,000 counts, so the demo runs it on no real machine. If yours has room for that, run it yourself after \
         `cargo xtask demo`:\n    {instead}"
    )]
    NotSimulated { link: String, instead: String },
    #[error("there is no fuzz target {name}; there are: {known}")]
    NoFuzzTarget { name: String, known: String },
    #[error("fuzz target {target} found a failure; the end of its output is above. Repeat it with:\n    {again}")]
    Fuzz { target: String, again: String },
    #[error("fuzz target {target} stopped without a figure; its whole output: {}", log.display())]
    FuzzSilent { target: String, log: PathBuf },
    #[error(
        "{rooms}: mutants survive without a reason, are not tried yet, or too many survive. Write a test for each, or \
         give its reason in {reasons}; then go on with the same command"
    )]
    Mutants { rooms: String, reasons: &'static str },
    #[error("{} cannot be read ({source}); begin anew with --again", path.display())]
    Known { path: PathBuf, source: serde_json::Error },
    #[error(
        "{} is not the file that is known: its SHA-256 is {found} instead of {expected}; fetch it again, and if it \
         stays so, find out what has changed before you change the sum in xtask/src/", file.display()
    )]
    Fetched { file: PathBuf, expected: &'static str, found: String },
    #[error("{0}")]
    Rig(&'static str),
    #[error("the kernel has no module {name}; name another one in xtask/src/rig/guest.rs")]
    NoModule { name: String },
    #[error("{why}; the end of its output is above, the whole output: {}", log.display())]
    Guest { why: &'static str, log: PathBuf },
    #[error("a line of a bench is no figure: {line}\n    ({source}); print figures by benches/common")]
    Figure { line: String, source: serde_json::Error },
    #[error("{} is not a DLL of the expected form: {what}", path.display())]
    Dll { path: PathBuf, what: String },
    #[error("the files' time is not known: set {variable} (seconds since 1970), or build from a git clone")]
    NoTime { variable: &'static str },
    #[error("{0}")]
    Package(String),
    #[error(
        "the shipped packages cannot be listed: {0}; does Cargo.lock belong to this tree? `cargo metadata --locked` \
         says more"
    )]
    Sbom(String),
    #[error("cannot keep the bench on one processor ({0}); start it by `taskset --cpu-list 0`")]
    Processor(io::Error),
    #[error(
        "there is no release to compare with; the first one is made by a tag with the version of Cargo.toml:\n    \
         git tag v{}\nFrom then on this command lists breaking changes",
        env!("CARGO_PKG_VERSION")
    )]
    NoRelease,
    #[error(
        "{file} is no longer as {tag} was released; take it back by `git checkout {tag} -- {file}`. What is new belongs to \
         the next version: raise the one in Cargo.toml"
    )]
    Surface { file: String, tag: String },
    #[error("no test has {names} in its name")]
    NoTest { names: String },
    #[error("no bench printed a figure; is the name right? They are the files of benches/")]
    NoFigures,
    #[error("{misses} of {demands} figures miss their target; a busy machine? Measure again with:\n    {again}")]
    Slow { misses: usize, demands: usize, again: &'static str },
}

impl Error {
    /// Returns a function for `map_err` that adds the operation (`doing`) and the path to an I/O error.
    pub fn file(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::File { doing, path: path.to_owned(), source }
    }
}
