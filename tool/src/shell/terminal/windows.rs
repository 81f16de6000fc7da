//! The console's modes.

use std::io;
use std::os::windows::io::AsRawHandle;

use windows_sys::Win32::System::Console::{GetConsoleMode, SetConsoleMode};

/// How it was.
pub struct Terminal(Option<u32>);

impl Terminal {
    /// How it is, if there is one.
    pub fn now() -> Self {
        let mut mode = 0;
        // SAFETY: standard input's handle is open as long as the process; `mode` takes a number.
        let is_one = unsafe { GetConsoleMode(io::stdin().as_raw_handle().cast(), &raw mut mode) } != 0;
        Self(is_one.then_some(mode))
    }

    /// Makes it so again.
    pub fn restore(&self) {
        if let Some(mode) = self.0 {
            // SAFETY: standard input's handle is open as long as the process.
            unsafe { SetConsoleMode(io::stdin().as_raw_handle().cast(), mode) };
        }
    }
}
