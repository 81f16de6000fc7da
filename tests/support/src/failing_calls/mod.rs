//! A program whose Nth system call fails, or that is killed there. The test traces it (ptrace), so that calls of the C
//! library, of the dynamic loader and of every thread count, in the order in which the threads make them. After the blow the
//! program runs on at full speed.
//!
//! - `mod.rs`: what is struck and how that ended
//! - `deal.rs`: which blows a test deals, and what holds after each
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

/// Whose calls count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Whose {
    /// Those of the program that is started; a program that this one starts runs untraced from its `execve` on.
    Program,
    /// Those of the programs that it starts.
    ItsPrograms,
}

/// A blow: the call of that number, counted from 0 among those that may fail, fails with the error of that number among those
/// that it may give. A number behind the last error kills the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blow {
    /// Which call.
    pub call: usize,
    /// Which error; [`Blow::KILL`]: none, the process ends.
    pub error: usize,
}

impl Blow {
    /// The process is killed at that call.
    pub const KILL: usize = usize::MAX;
}

/// A call that may fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Call {
    /// Its name.
    pub name: &'static str,
    /// What its file descriptor is of.
    pub of: Of,
    /// What it may give.
    pub errors: &'static [i32],
}

/// A blow as it was dealt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dealt {
    /// The call.
    pub call: Call,
    /// The descriptor or first argument.
    pub argument: u64,
    /// Its error; `None`: the process was killed.
    pub errno: Option<i32>,
    /// It was a call of the dynamic loader, which runs before the program.
    pub is_loading: bool,
}

impl Dealt {
    /// Whether that error came of a write to that descriptor.
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

/// How a struck program has ended.
#[derive(Debug)]
pub struct Struck {
    /// Its end.
    pub ended: Ended,
    /// The calls that may fail, up to the blow.
    pub calls: Vec<Call>,
    /// The blow; `None` if the program made no such call.
    pub dealt: Option<Dealt>,
    /// If it did not end in the given time and was killed: what its threads were at.
    pub hung: Option<String>,
}

/// What a program that runs has said so far, for a test that has to do with it meanwhile.
#[derive(Default)]
pub struct Watched {
    pub(crate) id: Mutex<Option<i32>>,
    pub(crate) stdout: Mutex<String>,
}

impl Watched {
    /// Its process id, once it was started.
    ///
    /// # Panics
    /// Another thread has.
    pub fn id(&self) -> Option<i32> {
        *self.id.lock().expect("no panic")
    }

    /// Its standard output.
    ///
    /// # Panics
    /// Another thread has.
    pub fn stdout(&self) -> String {
        self.stdout.lock().expect("no panic").clone()
    }
}
