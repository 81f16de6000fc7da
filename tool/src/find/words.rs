//! The words and signs of the expressions of `ecmsk find`.

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

/// The words of the board and of the language.
const WORDS: [&str; 8] = ["state", "fifo", "gap", "abs", "and", "or", "not", "OP"];

/// The signs of comparisons; those that begin like another one come before it.
pub const COMPARISONS: [(&str, Comparison); 7] = [
    ("<=", Comparison { orders: &[Ordering::Less, Ordering::Equal] }),
    (">=", Comparison { orders: &[Ordering::Greater, Ordering::Equal] }),
    ("==", Comparison { orders: &[Ordering::Equal] }),
    ("!=", Comparison { orders: &[Ordering::Less, Ordering::Greater] }),
    ("<", Comparison { orders: &[Ordering::Less] }),
    (">", Comparison { orders: &[Ordering::Greater] }),
    ("=", Comparison { orders: &[Ordering::Equal] }),
];

/// The error for a word that is not known, with one like it if there is one, otherwise all.
pub fn unknown(word: &str) -> String {
    /// How similar a word has to be to be shown alone, as clap has it.
    const SIMILAR: f64 = 0.7;
    let words = || OF_AXIS.iter().map(|(name, _)| *name).chain(FLAGS.iter().map(|(name, _)| *name)).chain(WORDS);
    let lower = word.to_lowercase();
    let similar = words().map(|known| (strsim::jaro(known, &lower), known)).max_by(|a, b| a.0.total_cmp(&b.0));
    match similar.filter(|(similarity, _)| *similarity > SIMILAR) {
        Some((_, known)) => format!("`{word}` is not known; write `{known}`"),
        None => format!("`{word}` is not known; there are {}", words().collect::<Vec<_>>().join(", ")),
    }
}
