//! The requests to end the tool: signals, and on Windows events of the console.
//!
//! Each has a number like that of a signal, since the exit code is 128 + n.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub use unix::{EndRequest, HANG_UP, has_hung_up, name, not_ignored, note, note_once};
#[cfg(windows)]
pub use windows::{EndRequest, HANG_UP, has_hung_up, leave_to_program, name, note, note_once};
