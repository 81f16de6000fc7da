//! The option `--slot-size`.
//!
//! The former name `--slot` meant the slot size in some verbs, and selected slots in others. It is still accepted where its
//! meaning is certain, with a note on the present name.

use std::sync::Once;

use ecmsk::sk::SlotSize;

use super::stderr::say;

/// Parses `12` or `16`.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn parse(text: &str) -> Result<SlotSize, String> {
    text.parse().ok().and_then(SlotSize::from_bytes).ok_or_else(|| "allowed: 12, 16".to_owned())
}

/// The slot size of `--slot-size`, or else of `--slot`, its former name.
pub fn given(size: Option<SlotSize>, slot: Option<SlotSize>) -> Option<SlotSize> {
    if let Some(slot) = slot {
        hint("--slot", &format!("--slot-size {}", slot.bytes()));
    }
    size.or(slot)
}

/// Prints a note that the former option name `old` is accepted and that `new` is its present name. Only the first call in a
/// process prints it.
pub fn hint(old: &str, new: &str) {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| say("note", &format_args!("{old} is understood here as {new}; write it so, in all verbs alike")));
}
