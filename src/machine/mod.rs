//! What this machine has to reach a board with. Nothing is opened for good, and no right is needed.
//!
//! [`Machine`] reads facts, of Linux or of Windows; [`findings`] says what is right or wrong with them, and what to do;
//! [`timing`] measures.

pub mod findings;
#[cfg(target_os = "linux")]
mod linux;
pub mod timing;
#[cfg(windows)]
mod windows;

#[cfg(target_os = "linux")]
pub use linux::{Access, Machine, gpio, holders, limits, spi, udev, usb};
#[cfg(windows)]
pub use windows::{Board, Machine};

/// \[OURS] Characters that are shown of a text that a device or a file says, as many as a USB string has at most.
const SHOWN_MAX: usize = 126;

/// A text from outside as it may stand on a terminal: without what controls one, and not endless.
pub fn printable(text: &str) -> String {
    let shown = text.chars().take(SHOWN_MAX);
    shown.map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).collect()
}
