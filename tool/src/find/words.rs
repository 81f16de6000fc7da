//! The words and operators of the expressions of `ecmsk find`.

use std::cmp::Ordering;

use ecmsk::cia402::Statusword;

use super::condition::{Comparison, Flag, OfAxis};
use crate::motion::Quantity;

/// The quantities of an axis, by name.
pub const OF_AXIS: [(&str, OfAxis); 7] = [
    ("position", OfAxis::Position),
    ("target", OfAxis::Target),
    ("following_error", OfAxis::Moving(Quantity::FollowingError)),
    ("target_step", OfAxis::Moving(Quantity::TargetStep)),
    ("velocity", OfAxis::Moving(Quantity::Velocity)),
    ("torque", OfAxis::Moving(Quantity::Torque)),
    ("alarm", OfAxis::Alarm),
];

/// The states of an axis, by name.
pub const FLAGS: [(&str, Flag); 10] = [
    ("enabled", Flag::Enabled),
    ("fault", Flag::Fault),
    ("quick_stop", Flag::QuickStop),
    ("homing", Flag::Homing),
    ("lost", Flag::Lost),
    ("voltage_enabled", Flag::Bit(Statusword::VOLTAGE_ENABLED)),
    ("warning", Flag::Bit(Statusword::WARNING)),
    ("remote", Flag::Bit(Statusword::REMOTE)),
    ("target_reached", Flag::Bit(Statusword::TARGET_REACHED)),
    ("internal_limit", Flag::Bit(Statusword::INTERNAL_LIMIT)),
];

/// All other words of the language, for [`unknown`].
const WORDS: [&str; 8] = ["state", "fifo", "gap", "abs", "and", "or", "not", "OP"];

/// The comparison operators. An operator that begins with another one, such as `<=`, comes before that one.
pub const COMPARISONS: [(&str, Comparison); 7] = [
    ("<=", Comparison { orders: &[Ordering::Less, Ordering::Equal] }),
    (">=", Comparison { orders: &[Ordering::Greater, Ordering::Equal] }),
    ("==", Comparison { orders: &[Ordering::Equal] }),
    ("!=", Comparison { orders: &[Ordering::Less, Ordering::Greater] }),
    ("<", Comparison { orders: &[Ordering::Less] }),
    (">", Comparison { orders: &[Ordering::Greater] }),
    ("=", Comparison { orders: &[Ordering::Equal] }),
];

/// The error for an unknown word. It suggests the most similar word, or lists all words if none is similar.
pub fn unknown(word: &str) -> String {
    /// The smallest similarity at which a word is suggested; clap uses the same value.
    const SIMILAR: f64 = 0.7;
    let words = || OF_AXIS.iter().map(|(name, _)| *name).chain(FLAGS.iter().map(|(name, _)| *name)).chain(WORDS);
    let lower = word.to_lowercase();
    let similar = words().map(|known| (strsim::jaro(known, &lower), known)).max_by(|a, b| a.0.total_cmp(&b.0));
    match similar.filter(|(similarity, _)| *similarity > SIMILAR) {
        Some((_, known)) => format!("`{word}` is not known; write `{known}`"),
        None => format!("`{word}` is not known; there are {}", words().collect::<Vec<_>>().join(", ")),
    }
}
