//! Runs a program whose Nth system call fails, or that is killed there. The test traces it (ptrace), so that calls of
//! the C library, of the dynamic loader and of every thread count, in the order in which the threads make them. After
//! the failure the program runs on at full speed.
//!
//! - `mod.rs`: which call fails, and how the run ended
//! - `deal.rs`: which calls a test makes fail, and what must hold afterwards
//! - `table.rs`: which errors a call may give
//! - `tracer.rs`: the tracing itself

mod deal;
mod table;
mod tracer;

use std::fmt;
use std::sync::Mutex;

use crate::Ended;
pub use deal::{Run, strike};
pub use table::Of;
pub use tracer::run;

/// Whose calls are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Whose {
    /// Calls of the started program; a program that it starts runs untraced from its `execve` on.
    Program,
    /// Calls of the programs that it starts.
    ItsPrograms,
}

/// A failure: the call with this number, counted from 0 among the calls that may fail, fails with the error of this
/// number among its possible errors. A number after the last error kills the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blow {
    /// Which call.
    pub call: usize,
    /// Which error; with [`Blow::KILL`] the process is killed instead.
    pub error: usize,
}

impl Blow {
    /// Kills the process at that call.
    pub const KILL: usize = usize::MAX;
}

/// A call that may fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Call {
    /// Its name.
    pub name: &'static str,
    /// The kind of its file descriptor.
    pub of: Of,
    /// The errors that it may give.
    pub errors: &'static [i32],
}

/// A failure as it happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dealt {
    /// The call.
    pub call: Call,
    /// The descriptor or first argument.
    pub argument: u64,
    /// Its error; `None`: the process was killed.
    pub errno: Option<i32>,
    /// Whether the dynamic loader made the call, before the program ran.
    pub is_loading: bool,
}

impl Dealt {
    /// Whether the failed call was a write to that descriptor.
    pub fn is_write_to(&self, descriptor: u64) -> bool {
        self.call.name.starts_with("write") && self.argument == descriptor && self.errno.is_some()
    }
}

impl fmt::Display for Dealt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Call { name, of, .. } = self.call;
        let error = self.errno.map(std::io::Error::from_raw_os_error);
        match error {
            Some(error) => write!(f, "{name}({:#x}), {of:?}: {error}", self.argument),
            None => write!(f, "killed at {name}({:#x}), {of:?}", self.argument),
        }
    }
}

/// The end of a program with a failed call.
#[derive(Debug)]
pub struct Struck {
    /// Exit status and output.
    pub ended: Ended,
    /// The calls that may fail, up to the failure.
    pub calls: Vec<Call>,
    /// The failure; `None` if the program made no such call.
    pub dealt: Option<Dealt>,
    /// What its threads were doing, if it did not end in time and was killed.
    pub hung: Option<String>,
}

/// The output of a running program so far, for a test that talks to it meanwhile.
#[derive(Default)]
pub struct Watched {
    pub(crate) id: Mutex<Option<i32>>,
    pub(crate) stdout: Mutex<String>,
}

impl Watched {
    /// Its process id, once it was started.
    ///
    /// # Panics
    /// If another thread has panicked.
    pub fn id(&self) -> Option<i32> {
        *self.id.lock().expect("no panic")
    }

    /// Its standard output.
    ///
    /// # Panics
    /// If another thread has panicked.
    pub fn stdout(&self) -> String {
        self.stdout.lock().expect("no panic").clone()
    }
}
