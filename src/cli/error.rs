//! Why a verb failed, and the exit code that says so.

use std::io::{self, Write};
use std::process::ExitCode;

use ecmsk::link::record::RecordError;

use super::board::BoardError;

/// Why the tool failed. Every text ends with the next step.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// Standard output took no more.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(#[from] io::Error),
    /// See [`RecordError`].
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// See [`super::dump::DumpError`].
    #[error(transparent)]
    Dump(#[from] super::dump::DumpError),
    /// See [`super::plot::PlotError`].
    #[error(transparent)]
    Plot(#[from] super::plot::PlotError),
    /// See [`super::board::BoardError`].
    #[error(transparent)]
    Board(#[from] super::board::BoardError),
    /// See [`super::compare::CompareVerbError`].
    #[error(transparent)]
    Compare(#[from] super::compare::CompareVerbError),
    /// See [`super::replay::ReplayVerbError`].
    #[error(transparent)]
    Replay(#[from] super::replay::ReplayVerbError),
    /// See [`super::man::ManError`].
    #[error(transparent)]
    Man(#[from] super::man::ManError),
    /// See [`super::monitor::MonitorError`].
    #[error(transparent)]
    Monitor(#[from] super::monitor::MonitorError),
    /// See [`super::doctor::RuleError`].
    #[cfg(target_os = "linux")]
    #[error(transparent)]
    UdevRule(#[from] super::doctor::RuleError),
    /// See [`super::doctor::FolderError`].
    #[error(transparent)]
    Folder(#[from] super::doctor::FolderError),
    /// See [`super::exec::ExecError`].
    #[error(transparent)]
    Exec(#[from] super::exec::ExecError),
    /// See [`ecmsk::port::tcp::ServeError`].
    #[error(transparent)]
    Serve(#[from] ecmsk::port::tcp::ServeError),
    /// See [`ecmsk::port::usbip::ServeError`].
    #[error(transparent)]
    Usbip(#[from] ecmsk::port::usbip::ServeError),
}

impl CliError {
    /// Tells the user, and gives the exit code.
    ///
    /// A reader that has seen enough (`ecmsk dump F | head`) is no failure: nothing is said then.
    pub fn report(&self) -> ExitCode {
        if let Self::Output(error) | Self::Board(BoardError::Output(error)) = self
            && error.kind() == io::ErrorKind::BrokenPipe
        {
            return ExitCode::SUCCESS;
        }
        say("error", self);
        match self {
            Self::Exec(error) => ExitCode::from(error.code()),
            Self::Board(error) => ExitCode::from(error.code()),
            Self::Compare(_) | Self::Replay(_) => ExitCode::from(super::compare::TROUBLE),
            _ => ExitCode::FAILURE,
        }
    }
}

/// A line on standard error, `kind: what`. That nobody may be there to read it is not worth a panic.
pub fn say(kind: &str, what: &dyn std::fmt::Display) {
    let _ = writeln!(io::stderr(), "{kind}: {what}");
}
