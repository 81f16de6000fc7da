//! `--clock virtual`: the program's waits and clocks on the virtual clock of its board. A library that is preloaded into the
//! program does that (docs/decisions/sleeping-programs-are-preloaded.md).

#[cfg(target_os = "linux")]
mod linux;

#[cfg(target_os = "linux")]
pub use linux::{FILE_NAME, Preloaded};
#[cfg(not(target_os = "linux"))]
pub use other::{FILE_NAME, Preloaded};

/// The clock of the program and its board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ProgramClock {
    /// It goes on when all threads of the program wait
    Virtual,
}

#[cfg(not(target_os = "linux"))]
mod other {
    use std::path::Path;
    use std::process::Command;

    use crate::exec::ExecError;
    use crate::exec::library::LibraryFolder;

    pub const FILE_NAME: &str = "preloaded library";

    pub struct Preloaded;

    impl Preloaded {
        pub fn set(_command: &mut Command, _library: &LibraryFolder) -> Result<Self, ExecError> {
            Err(ExecError::NoSuchClock)
        }

        pub fn say(self, _program: &Path, _is_verbose: bool) {}
    }
}
