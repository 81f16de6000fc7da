//! Requests to end the tool: signals, or on Windows console events such as Ctrl-C.
//!
//! Each request has a signal number, because the exit code is 128 plus that number.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub use unix::{EndRequest, HANG_UP, has_hung_up, name, not_ignored, note, note_once, raise_interrupt};
#[cfg(windows)]
pub use windows::{EndRequest, HANG_UP, has_hung_up, leave_to_program, name, note, note_once, raise_interrupt};
