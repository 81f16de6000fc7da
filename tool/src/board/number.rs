//! Parsers for times and numbers on the command line.

use std::time::Duration;

use crate::filter::parse_seconds;

/// Parses a time above 0: `0.5s`, `500ms`, `2` (seconds).
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn duration(text: &str) -> Result<Duration, String> {
    let seconds = parse_seconds(text).ok().filter(|seconds| (1e-6..=86_400.0).contains(seconds));
    seconds.map(Duration::from_secs_f64).ok_or_else(|| "allowed: a time up to a day, e.g. 10s, 0.5s or 500ms".into())
}

/// Parses a number above 0.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "allowed: a number above 0".into())
}

/// Parses a position, in counts or in units: a number from -2147483648 to 2147483647.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn position(text: &str) -> Result<f64, String> {
    let range = f64::from(i32::MIN)..=f64::from(i32::MAX);
    let number = text.parse::<f64>().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("{text} is not in -2147483648..=2147483647"))
}

/// Parses a number that is 0 or more.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn not_negative(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite() && *number >= 0.0);
    number.ok_or_else(|| "allowed: a number from 0".into())
}

/// Parses a whole number, decimal or hexadecimal with 0x, with an optional minus sign.
pub fn whole(text: &str) -> Option<i64> {
    let (sign, digits) = text.strip_prefix('-').map_or((1, text), |digits| (-1, digits));
    let hex = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X"));
    let (digits, radix) = hex.map_or((digits, 10), |hex| (hex, 16));
    // Only digits are allowed here, because `from_str_radix` would accept another sign.
    let known = !digits.is_empty() && digits.chars().all(|digit| digit.is_digit(radix));
    known.then(|| i64::from_str_radix(digits, radix).ok()).flatten().map(|number| sign * number)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Valid times and numbers are parsed, others are refused.
    #[test]
    fn times_and_numbers_are_read_or_refused() {
        assert_eq!(duration("2"), Ok(Duration::from_secs(2)));
        assert_eq!(duration("0.5s"), duration("500ms"));
        for wrong in ["", "s", "ms", "-1s", "0", "nan", "inf", "1h", "86401", "1e-9"] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
        assert_eq!(
            (whole("0x10"), whole("-16"), whole("-0x10"), whole("0X1f")),
            (Some(16), Some(-16), Some(-16), Some(31))
        );
        for wrong in ["", "-", "0x", "+1", "--1", "1.5", "0xg", "99999999999999999999"] {
            assert_eq!(whole(wrong), None, "{wrong}");
        }
        assert!(positive("0").is_err() && positive("1e3") == Ok(1000.0) && not_negative("0") == Ok(0.0));
        assert!(not_negative("-0.1").is_err() && not_negative("nan").is_err() && positive("inf").is_err());
    }
}
