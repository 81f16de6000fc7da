//! Numbers as people write them.

use std::time::Duration;

/// `0.5s`, `500ms`, `2` (seconds); above 0.
///
/// # Errors
/// What is allowed.
pub fn duration(text: &str) -> Result<Duration, String> {
    let (number, unit) = match text.strip_suffix("ms") {
        Some(number) => (number, 1e-3),
        None => (text.strip_suffix('s').unwrap_or(text), 1.0),
    };
    let seconds = number.trim().parse::<f64>().ok().map(|number| number * unit);
    let seconds = seconds.filter(|seconds| (1e-6..=86_400.0).contains(seconds));
    seconds.map(Duration::from_secs_f64).ok_or_else(|| "allowed: a time up to a day, e.g. 10s, 0.5s or 500ms".into())
}

/// A number above 0.
///
/// # Errors
/// What is allowed.
pub fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "allowed: a number above 0".into())
}

/// A whole number, decimal or with 0x, maybe with a minus.
pub fn whole(text: &str) -> Option<i64> {
    let (sign, digits) = text.strip_prefix('-').map_or((1, text), |digits| (-1, digits));
    let hex = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X"));
    let (digits, radix) = hex.map_or((digits, 10), |hex| (hex, 16));
    // `from_str_radix` would take another sign.
    let known = !digits.is_empty() && digits.chars().all(|digit| digit.is_digit(radix));
    known.then(|| i64::from_str_radix(digits, radix).ok()).flatten().map(|number| sign * number)
}
