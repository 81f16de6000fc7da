//! Saves and restores the modes of the terminal, because a signal may end the shell while the line editor has changed
//! them.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub use unix::Terminal;
#[cfg(windows)]
pub use windows::Terminal;
