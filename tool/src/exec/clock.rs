//! `--clock virtual`: puts the waits and clocks of the program on the virtual clock of its board. A library that is
//! preloaded into the program does this (docs/decisions/sleeping-programs-are-preloaded.md). It exists only for 64-bit
//! machines: on a 32-bit machine a program may call functions with 64-bit times, which the library does not replace.

#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod linux;

#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
pub use linux::{FILE_NAME, Preloaded};
#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
pub use other::Preloaded;

/// The clock of the program and its board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ProgramClock {
    /// It goes on when all threads of the program wait
    Virtual,
}

#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
mod other {
    use std::path::Path;
    use std::process::Command;

    use crate::exec::ExecError;
    use crate::exec::library::LibraryFolder;

    pub struct Preloaded;

    impl Preloaded {
        pub fn set(_command: &mut Command, _library: &LibraryFolder) -> Result<Self, ExecError> {
            Err(ExecError::NoSuchClock)
        }

        pub fn say(self, _program: &Path, _is_verbose: bool, _is_opened: bool) {}
    }
}
