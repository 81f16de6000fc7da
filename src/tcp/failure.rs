//! [`LinkError`] in messages: converts an error of the server's link to a message and back to an error of the client's
//! link.

use super::wire::Failure;
use crate::link::{Dir, LinkError, Wait};

const TIMEOUT: u8 = 1;
const SILENT: u8 = 2;
const LOST: u8 = 3;
const CANCELLED: u8 = 4;
const CLOSED: u8 = 5;
const OTHER: u8 = 6;
/// A client that does not know this code takes it as [`OTHER`].
const BEYOND_LIMIT: u8 = 7;

impl<'a> Failure<'a> {
    /// The failure to send to the client for an error of the server's link; `text` is a buffer for its text.
    pub fn of(error: &LinkError, text: &'a mut String) -> Self {
        text.clear();
        let (code, numbers) = match error {
            LinkError::Timeout { .. } => (TIMEOUT, [0; 2]),
            LinkError::Silent { since_ns, cycles } => (SILENT, [*since_ns, *cycles]),
            LinkError::Lost { reason, .. } => {
                text.push_str(reason);
                (LOST, [0; 2])
            }
            LinkError::Cancelled { .. } => (CANCELLED, [0; 2]),
            LinkError::Closed => (CLOSED, [0; 2]),
            LinkError::BeyondLimit { at_ns, why } => {
                text.push_str(why);
                (BEYOND_LIMIT, [*at_ns, 0])
            }
            other => {
                text.push_str(&other.to_string());
                (OTHER, [0; 2])
            }
        };
        Self { code, numbers, text }
    }

    /// The error of a client's call on the link `name` for a failure that the server has sent. `dir` and `wait` are those of
    /// the call; error texts name them.
    pub fn error(&self, name: &str, dir: Dir, wait: Wait) -> LinkError {
        match self.code {
            TIMEOUT => LinkError::timed_out(dir, wait),
            SILENT => LinkError::Silent { since_ns: self.numbers[0], cycles: self.numbers[1] },
            LOST => LinkError::Lost { name: name.to_owned(), reason: self.text.to_owned().into() },
            BEYOND_LIMIT => LinkError::BeyondLimit { at_ns: self.numbers[0], why: self.text.to_owned() },
            CANCELLED => LinkError::Cancelled { dir },
            CLOSED => LinkError::Lost { name: name.to_owned(), reason: "the server has closed its link".into() },
            _ => LinkError::Io { what: format!("{dir} on the server of `{name}`"), message: self.text.to_owned() },
        }
    }
}
