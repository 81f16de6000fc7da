//! The control socket of a simulated board (`control=`): a Unix socket that receives events while the board runs, in
//! the syntax of [`script`](super::script), and reports the cycle in which each event happened. `ecmsk fault` is its
//! client.
//!
//! A client sends one line with the event. The server answers with the line `taken` when the event waits for the next
//! cycle, then with `done CYCLE NANOSECONDS`. If it answers `wrong TEXT` or `failed TEXT`, the event does not happen.
//! If the client disconnects before the event has happened, the event is cancelled. On a virtual clock, an event waits
//! until the program lets a cycle pass.
//!
//! \[OURS] Each time the link is opened, everything that events did before is undone, as with a script.
//!
//! - `place.rs`: the path of a socket, by name
//! - `server.rs`: the thread of the socket, in the process of the board; the cycle's part is in `script/injected.rs`
//! - `client.rs`: [`Injection`]

#[cfg(unix)]
mod client;
#[cfg(unix)]
mod place;
#[cfg(unix)]
mod server;

use std::time::Duration;

#[cfg(unix)]
pub use client::Injection;
#[cfg(unix)]
pub use place::place;
#[cfg(unix)]
pub(crate) use server::Control;

/// When an injected event happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Happened {
    /// The number of the cycle at whose beginning the event happened; 0 is the first cycle after the link was opened.
    pub cycle: u64,
    /// The beginning of that cycle, ns of board time since the link was opened.
    pub at_ns: u64,
}

/// Why an event was not injected. After any of these errors the event has not happened; only after [`Self::Unanswered`]
/// it can still happen.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ControlError {
    /// The name of the control socket is invalid.
    #[error("`{0}` is no name of a board; allowed: 1 to 64 letters, digits, `-`, `_` and `.`, or the path of a socket")]
    Name(String),
    /// The folder of the sockets cannot be used.
    #[error("cannot use {folder} for control sockets: {message}; give the path of a socket instead of a name")]
    Folder { folder: String, message: String },
    /// No board with this control socket is running.
    #[error("no board `{name}` is running{}; start it with --control {name}, or control={name} in its link", others(.running))]
    NotRunning {
        name: String,
        /// The names of the boards that are running.
        running: Vec<String>,
    },
    /// The event is invalid for this board.
    #[error("{text}; see `ecmsk link help`")]
    Wrong { text: String },
    /// The board did not carry the event out.
    #[error("{text}")]
    Failed { text: String },
    /// No cycle of the board has begun within the time limit. The event keeps waiting until its [`Injection`] is
    /// dropped.
    #[error(
        "no cycle of the board began within {} s, so that nothing happened; on a virtual clock time passes only while the \
         program reads and writes",
        .0.as_secs_f64()
    )]
    Unanswered(Duration),
    /// The connection to the board failed.
    #[error("the control socket {path}: {message}; is the board's process still there?")]
    Io { path: String, message: String },
}

fn others(running: &[String]) -> String {
    if running.is_empty() { ", and no other".to_owned() } else { format!(", but {}", running.join(", ")) }
}
