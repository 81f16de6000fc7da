//! The Nth system call of the tool, of a program on the library and of a server fails, with each possible error, or the
//! process is killed there. Whatever fails: no axis moves without a living writer, no frame is lost uncounted, every
//! run ends, and a run that has lost something does not end with exit status 0.
//!
//! A part of all failures is tested here, chosen by a seed. `cargo xtask soak` makes up to 10,000 for each test, or as many
//! as `--schedules` says; a test prints how many calls there are. To repeat one: `ECMSK_BLOW=CALL.ERROR`, as named by the
//! test's message.
//!
//! - `verbs.rs`: `ecmsk move`, in this process and on a served board, recorded or not
//! - `programs.rs`: a C program on the library, by itself and below `ecmsk exec`
//! - `server.rs`: `ecmsk serve tcp`
//! - `served.rs`: a served board whose writer fails
#![cfg(all(target_os = "linux", target_arch = "x86_64"))]

mod programs;
mod served;
mod server;
mod verbs;

use std::time::Duration;

use support::failing_calls::{self, Blow, Run};

/// A run takes a fraction of a second. The limit ends one that hangs.
const LIMIT: Duration = Duration::from_secs(60);
/// By default each error of each call is injected once, at any of the places where the call is made.
const EACH_ONCE: usize = usize::MAX;
/// The number of failures injected where a run takes much of a second.
const FEW: usize = 24;

fn strike(test: &str, usual: usize, run: impl Fn(Option<Blow>) -> Run) {
    failing_calls::strike("cargo test --test failing_calls", test, usual, run);
}
