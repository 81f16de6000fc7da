//! [`LinkError`]: why opening a link or a call on it has failed.

use std::borrow::Cow;
use std::time::Duration;

use super::machine_error::{ManufacturerObjectsError, ScriptError};
use super::{Dir, Wait};
use crate::address::{config, uri};
use crate::sk::SlotSize;
use crate::span::Span;

/// Why a link call failed. The message of every variant says what happened, on which link, and what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum LinkError {
    /// The URI or one of its keys is invalid.
    #[error(transparent)]
    Uri(#[from] uri::UriError),
    /// The configuration file that names the link cannot be used.
    #[error(transparent)]
    Config(#[from] config::ConfigError),
    /// The file with a simulated slave's manufacturer-specific objects is invalid.
    #[error(transparent)]
    ManufacturerObjects(#[from] ManufacturerObjectsError),
    /// The script of faults of the simulated slaves (key `script=`) is invalid.
    #[error(transparent)]
    Script(#[from] ScriptError),
    /// This build cannot open links with this scheme.
    #[error("link `{scheme}:` is not in this build; {hint}")]
    Unsupported {
        scheme: String,
        /// What the user can do instead.
        hint: String,
    },
    /// No board answers.
    #[error("no board at `{name}`: {reason}")]
    NoBoard {
        name: String,
        /// What was found instead, and what the user can do.
        reason: String,
    },
    /// The slot size in the URI differs from that of the board's reports.
    #[error(
        "`{name}` says slot={}, but slots of the board's reports have {} bytes (CONFIG2 {}); write slot={} into the link, \
         and use a program for slots of that size",
        given.bytes(), found.bytes(), config2(*found), found.bytes()
    )]
    WrongSlot {
        name: String,
        /// The slot size in the URI.
        given: SlotSize,
        /// The slot size of the reports.
        found: SlotSize,
    },
    /// Another program, or another link of this program, has the board open.
    #[error("`{name}` is in use{by}; close it there, or {instead}")]
    InUse {
        name: String,
        /// The user of the board in the form ` by ...`, or empty if unknown.
        by: String,
        /// What the user can do if the other user of the board cannot close it.
        instead: &'static str,
    },
    /// The time limit of a call has passed.
    #[error("{dir} {}: {what}", how_long(*waited))]
    Timeout {
        dir: Dir,
        /// The limit; zero for a call that must not wait.
        waited: Duration,
        /// What the call was waiting for.
        what: &'static str,
    },
    /// On a virtual clock: the board makes no reports, and nothing can change that during the read, because time
    /// advances only inside calls.
    #[error(
        "the board has been silent since {} of its time ({cycles} cycles); plug the cable to the first slave, then read again",
        Span(Duration::from_nanos(*.since_ns))
    )]
    Silent {
        /// The board's time of its last report, in nanoseconds.
        since_ns: u64,
        /// The number of cycles without a report since `since_ns`.
        cycles: u64,
    },
    /// The board is gone: it was unplugged, or reset by SW_RESET.
    #[error("the board at `{name}` is gone: {reason}; open it again")]
    Lost { name: String, reason: Cow<'static, str> },
    /// The connection to the board's server ended during a write. The board may have got the frame or not.
    #[error(
        "the connection to `{name}` ended while a frame was on its way ({reason}): it is not known whether the board \
         took it; open it again and look at the board before you send anything twice"
    )]
    Unsure {
        name: String,
        /// How the connection ended.
        reason: String,
    },
    /// A target of an axis is beyond a limit of the machine file, and the file says that such targets are not sent. The
    /// board has got the frame without its CSP targets, so that all axes in CSP hold their last targets. All other
    /// commands of the frame were sent. The link can be used further.
    #[error("{why}")]
    BeyondLimit {
        /// The board's time at which the rest of the frame was sent, in nanoseconds.
        at_ns: u64,
        /// The axis with its target and its limit, and what the user can do.
        why: String,
    },
    /// The link was closed, by this thread or another one.
    #[error("the link is closed; open it first")]
    Closed,
    /// [`Link::cancel`](super::Link::cancel) ended the call.
    #[error("the {dir} was cancelled")]
    Cancelled { dir: Dir },
    /// The operating system reported an error.
    #[error("{what}: {message}")]
    Io {
        /// The operation that failed, with the file, device or address that it was for.
        what: String,
        /// The system's message.
        message: String,
    },
}

impl LinkError {
    /// The error of a read or write whose time limit has passed.
    pub(crate) fn timed_out(dir: Dir, wait: Wait) -> Self {
        let what = match dir {
            Dir::Write => "the board takes no more frames",
            Dir::Read => "no report came",
        };
        Self::Timeout { dir, waited: wait.limit().unwrap_or_default(), what }
    }

    /// The error of the link `name` when the system provides no thread.
    pub(crate) fn no_thread(name: &str, error: &std::io::Error) -> Self {
        Self::Io {
            what: format!("start the thread of `{name}`"),
            message: format!("{error}; free some threads (`ulimit -u`) and open it again"),
        }
    }
}

/// The level of the jumper CONFIG2 that selects a slot size.
const fn config2(size: SlotSize) -> &'static str {
    match size {
        SlotSize::Bytes12 => "low",
        SlotSize::Bytes16 => "high",
    }
}

fn how_long(waited: Duration) -> String {
    if waited.is_zero() { "did not wait".to_owned() } else { format!("timed out after {}", Span(waited)) }
}
