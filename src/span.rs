//! Durations in messages, rounded to three digits, but at most to whole seconds.

use std::fmt;
use std::time::Duration;

/// A duration whose `Display` is rounded to three digits, but at most to whole seconds, in the unit that fits: `1.23s`,
/// `500ms`, `58us`, `7ns`, `3601s`.
pub(crate) struct Span(pub Duration);

/// The units with their lengths in nanoseconds, longest first.
const UNITS: [(&str, u128); 4] = [("s", 1_000_000_000), ("ms", 1_000_000), ("us", 1_000), ("ns", 1)];
/// The number of significant digits of a duration below 1000 s; a longer one keeps all digits of its whole seconds.
const DIGITS: u32 = 3;

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let exact = self.0.as_nanos();
        // The rounding step is 1 s at most, so that a long duration keeps all digits of its whole seconds: `3601s`.
        let digits = exact.checked_ilog10().unwrap_or(0) + 1;
        let step = 10_u128.pow(digits.saturating_sub(DIGITS).min(9));
        let rounded = (exact + step / 2) / step * step;
        let (name, unit) = UNITS.into_iter().find(|(_, unit)| rounded >= *unit).unwrap_or(("s", 1_000_000_000));
        write!(f, "{}", rounded / unit)?;
        // The fraction with nine digits, from which trailing zeros are removed.
        let fraction = format!("{:09}", rounded % unit * (1_000_000_000 / unit));
        let fraction = fraction.trim_end_matches('0');
        if !fraction.is_empty() {
            write!(f, ".{fraction}")?;
        }
        f.write_str(name)
    }
}

/// A time as texts for people show it, in seconds since the board was opened: `1.758 s`, as recordings show it. The field is in
/// nanoseconds.
pub(crate) struct Seconds(pub u64);

impl fmt::Display for Seconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s", self.0 as f64 / 1e9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Durations are rounded to three digits, in the largest unit that they reach.
    #[test]
    fn times_are_rounded() {
        for (ns, said) in [
            (0, "0s"),
            (7, "7ns"),
            (999, "999ns"),
            (1_000, "1us"),
            (58_499, "58.5us"),
            (999_499, "999us"),
            (999_500, "1ms"),
            (1_250_000, "1.25ms"),
            (50_000_000, "50ms"),
            (1_234_567_891, "1.23s"),
            (30_000_000_001, "30s"),
            (90_500_000_000, "90.5s"),
            (3_600_000_000_000, "3600s"),
            (3_601_499_999_999, "3601s"),
        ] {
            assert_eq!(Span(Duration::from_nanos(ns)).to_string(), said);
        }
        assert_eq!(Span(Duration::MAX).to_string(), "18446744073709551616s");
    }
}
