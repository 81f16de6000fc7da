//! Saves and restores the modes of the console.

use std::io;
use std::os::windows::io::AsRawHandle;

use windows_sys::Win32::System::Console::{GetConsoleMode, SetConsoleMode};

/// The saved modes; `None` if standard input is not a console.
pub struct Terminal(Option<u32>);

impl Terminal {
    /// Saves the present modes of the console.
    pub fn now() -> Self {
        let mut mode = 0;
        // SAFETY: the handle of standard input is open as long as the process, and `mode` has room for the result.
        let is_one = unsafe { GetConsoleMode(io::stdin().as_raw_handle().cast(), &raw mut mode) } != 0;
        Self(is_one.then_some(mode))
    }

    /// Restores the saved modes.
    pub fn restore(&self) {
        if let Some(mode) = self.0 {
            // SAFETY: the handle of standard input is open as long as the process.
            unsafe { SetConsoleMode(io::stdin().as_raw_handle().cast(), mode) };
        }
    }
}
