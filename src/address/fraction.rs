//! Numbers from 0 to 1 in link URIs, such as `0.01`.

use std::fmt;

/// The largest number of digits after the decimal point.
const DIGITS: usize = 9;

/// A number from 0 to 1 with a resolution of one billionth: a probability, or a clock rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Fraction(u32);

impl Fraction {
    /// The number 0.
    pub const ZERO: Self = Self(0);
    /// The number 1.
    pub const ONE: Self = Self(1_000_000_000);

    /// The fraction with this number of billionths; values above one billion become 1.
    pub const fn from_billionths(billionths: u32) -> Self {
        if billionths > Self::ONE.0 { Self::ONE } else { Self(billionths) }
    }

    /// The fraction in billionths, 0..=1 000 000 000.
    pub const fn billionths(self) -> u32 {
        self.0
    }

    /// Parses `0.01`, `1`, `1.0` or `.5` with at most 9 digits after the point; `None` if the text is invalid.
    pub fn parse(text: &str) -> Option<Self> {
        let (whole, decimals) = text.split_once('.').unwrap_or((text, "0"));
        let whole = if whole.is_empty() && text.starts_with('.') { "0" } else { whole };
        let digits = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
        if !digits(whole) || !digits(decimals) || decimals.len() > DIGITS {
            return None;
        }
        let billionths = format!("{decimals:0<DIGITS$}").parse::<u64>().ok()?;
        let whole = whole.parse::<u64>().ok()?.checked_mul(Self::ONE.0.into())?;
        let sum = u32::try_from(whole.checked_add(billionths)?).ok()?;
        (sum <= Self::ONE.0).then_some(Self(sum))
    }
}

/// Writes the shortest form: `0`, `0.01`, `1`.
impl fmt::Display for Fraction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (whole, decimals) = (self.0 / Self::ONE.0, self.0 % Self::ONE.0);
        if decimals == 0 {
            return write!(f, "{whole}");
        }
        let decimals = format!("{decimals:0DIGITS$}");
        write!(f, "{whole}.{}", decimals.trim_end_matches('0'))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fraction_is_read_and_printed_exactly() {
        for (text, billionths, normal) in [
            ("0", 0, "0"),
            ("0.000", 0, "0"),
            ("1", 1_000_000_000, "1"),
            ("1.000000000", 1_000_000_000, "1"),
            (".5", 500_000_000, "0.5"),
            ("00.010", 10_000_000, "0.01"),
            ("0.000000001", 1, "0.000000001"),
            ("0.999999999", 999_999_999, "0.999999999"),
        ] {
            let fraction = Fraction::parse(text).expect(text);
            assert_eq!((fraction.billionths(), fraction.to_string().as_str()), (billionths, normal), "{text}");
        }
        for text in [
            "",
            ".",
            "1.",
            "1.000000001",
            "2",
            "-0",
            "+0.1",
            "1e-3",
            "0,1",
            "0.0000000001",
            "1 ",
            "99999999999999999999",
        ] {
            assert_eq!(Fraction::parse(text), None, "{text}");
        }
        assert_eq!(Fraction::from_billionths(u32::MAX), Fraction::ONE);
    }
}
