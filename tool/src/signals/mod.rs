//! What asks the tool to end: signals, and on Windows what a console sends.
//!
//! Each has a number, as signals have: the exit code is 128 + n.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub use unix::{Asked, HANG_UP, has_hung_up, name, not_ignored, note, note_once};
#[cfg(windows)]
pub use windows::{Asked, HANG_UP, has_hung_up, leave_to_program, name, note, note_once};
