//! The slot size as an option.

use ecmsk::sk::SlotSize;

/// Reads `12` or `16`.
///
/// # Errors
/// What is allowed.
pub fn parse(text: &str) -> Result<SlotSize, String> {
    text.parse().ok().and_then(SlotSize::from_bytes).ok_or_else(|| "allowed: 12, 16".to_owned())
}
