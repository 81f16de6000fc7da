//! Whether this machine is set up for a board: the boards that are connected, permissions, drivers, real-time limits.
//! The checks need no special rights and leave no device open.
//!
//! [`Machine`] reads the facts from Linux or Windows and judges them; a [`Finding`](findings::Finding) is one
//! judgement, with what to do about it. [`timing`] measures how exactly the machine wakes threads.
//!
//! Files: `findings.rs` (what a finding is), `linux/` (one file per subject: `usb`, `spi`, `gpio`, `gadget`, `net`, `udev`,
//! `limits`, `holders`; `linux/findings/` judges them), `windows/` (the same for Windows), `timing.rs`.

pub mod findings;
#[cfg(target_os = "linux")]
mod linux;
pub mod timing;
#[cfg(windows)]
mod windows;

#[cfg(target_os = "linux")]
pub use linux::{Access, Machine, gadget, gpio, holders, limits, net, spi, udev, usb};
#[cfg(windows)]
pub use windows::{Board, Machine};

/// \[OURS] The most characters that are shown of a text from a device or a file: as many as a USB string can have.
const SHOWN_MAX: usize = 126;

/// Makes a text from a device or a file safe to print: without control characters, and of limited length.
pub fn printable(text: &str) -> String {
    let shown = text.chars().take(SHOWN_MAX);
    shown.map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).collect()
}
