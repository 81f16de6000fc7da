//! The slot size as an option: `--slot-size` in every verb.
//!
//! `--slot` was the size in some verbs and a slot in others. It is understood where it can only mean one thing, and told what it
//! is called now.

use std::sync::Once;

use ecmsk::sk::SlotSize;

use super::error::say;

/// Reads `12` or `16`.
///
/// # Errors
/// What is allowed.
pub fn parse(text: &str) -> Result<SlotSize, String> {
    text.parse().ok().and_then(SlotSize::from_bytes).ok_or_else(|| "allowed: 12, 16".to_owned())
}

/// The size by `--slot-size`, else by `--slot` of a verb where that is the size.
pub fn given(size: Option<SlotSize>, slot: Option<SlotSize>) -> Option<SlotSize> {
    if let Some(slot) = slot {
        hint("--slot", &format!("--slot-size {}", slot.bytes()));
    }
    size.or(slot)
}

/// Says once what an option is called now.
pub fn hint(old: &str, new: &str) {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| say("note", &format_args!("{old} is understood here as {new}; write it so, in all verbs alike")));
}
