//! The words of a line and what they stand for.

use std::str::FromStr;

use crate::fieldbus::Ns;
use crate::link::Fraction;
use crate::link::uri::suggestion;

/// Where a line is wrong, as a character from 1, and how.
pub(super) type Wrong = (usize, String);

/// The words of a line that are not read yet.
pub(super) struct Words<'a> {
    line: &'a str,
    /// Byte in the line where the next word may begin.
    at: usize,
}

/// A word and the character where it begins.
#[derive(Clone, Copy)]
pub(super) struct Word<'a> {
    pub(super) text: &'a str,
    pub(super) column: usize,
}

impl Word<'_> {
    pub(super) fn wrong(&self, is: &str, allowed: &str) -> Wrong {
        (self.column, format!("`{}` is {is}; allowed: {allowed}", self.text))
    }

    /// It is none of the words that may stand there.
    pub(super) fn unknown(&self, what: &str, known: &[&'static str]) -> Wrong {
        let suggestion = suggestion(self.text, known.iter().copied());
        (self.column, format!("`{}` is no {what};{suggestion} allowed: {}", self.text, known.join(", ")))
    }
}

impl<'a> Words<'a> {
    /// The words before the comment.
    pub(super) fn of(line: &'a str) -> Self {
        Self { line: line.split_once('#').map_or(line, |(words, _)| words), at: 0 }
    }

    pub(super) fn peek(&self) -> Option<Word<'a>> {
        let rest = &self.line[self.at..];
        let word = rest.trim_start();
        let begin = self.at + rest.len() - word.len();
        let text = word.split_whitespace().next()?;
        Some(Word { text, column: 1 + self.line[..begin].chars().count() })
    }

    pub(super) fn next(&mut self) -> Option<Word<'a>> {
        let word = self.peek()?;
        let rest = &self.line[self.at..];
        self.at += rest.len() - rest.trim_start().len() + word.text.len();
        Some(word)
    }

    /// The next word, which must be there.
    pub(super) fn need(&mut self, what: &str, form: &str) -> Result<Word<'a>, Wrong> {
        let end = 1 + self.line.trim_end().chars().count();
        self.next().ok_or_else(|| (end, format!("{what} is missing; allowed: {form}")))
    }

    /// Takes the next word if it is that one.
    pub(super) fn take(&mut self, text: &str) -> bool {
        let there = self.peek().is_some_and(|word| word.text == text);
        if there {
            self.next();
        }
        there
    }
}

const TIMES: &str = "a time with its unit, such as 2.5s; units: us, ms, s, min, h; at most 1000h";
/// Units of time, the longer name before the one it ends with.
const UNITS: [(&str, Ns); 5] =
    [("us", 1_000), ("ms", 1_000_000), ("min", 60_000_000_000), ("s", 1_000_000_000), ("h", 3_600_000_000_000)];
/// The longest time \[OURS].
const LONGEST_NS: Ns = 1000 * 3_600_000_000_000;

/// A span of time, exact to the nanosecond.
pub(super) fn time(words: &mut Words, form: &str) -> Result<Ns, Wrong> {
    let word = words.need("TIME", form)?;
    span(word.text).ok_or_else(|| word.wrong("no time", TIMES))
}

fn span(text: &str) -> Option<Ns> {
    let (number, unit) = UNITS.iter().find_map(|(name, ns)| Some((text.strip_suffix(name)?, *ns)))?;
    let (whole, decimals) = number.split_once('.').unwrap_or((number, "0"));
    if whole.is_empty() || !whole.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let part = Fraction::parse(&format!("0.{decimals}"))?;
    let part = u128::from(part.billionths()) * u128::from(unit) / u128::from(Fraction::ONE.billionths());
    let ns = Ns::from_str(whole).ok()?.checked_mul(unit)?.checked_add(part as Ns)?;
    (ns <= LONGEST_NS).then_some(ns)
}

/// A whole number, decimal or `0x`.
pub(super) fn whole(text: &str) -> Option<u64> {
    let (digits, radix) = match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => (digits, 16),
        None => (text, 10),
    };
    // `from_str_radix` alone would let a plus sign pass.
    let plain = digits.bytes().all(|byte| byte.is_ascii_alphanumeric());
    u64::from_str_radix(digits, radix).ok().filter(|_| plain)
}

/// The next word as a whole number of a range.
pub(super) fn number(words: &mut Words, what: &str, form: &str, least: u64, most: u64) -> Result<u64, Wrong> {
    let word = words.need(what, form)?;
    let number = whole(word.text).filter(|number| (least..=most).contains(number));
    number.ok_or_else(|| word.wrong(&format!("no {what}"), &format!("a number from 0x{least:X} to 0x{most:X}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_exact() {
        for (text, ns) in [
            ("0s", 0),
            ("2.5s", 2_500_000_000),
            ("200ms", 200_000_000),
            ("0.25ms", 250_000),
            ("1us", 1000),
            ("0.001us", 1),
            ("1.5min", 90_000_000_000),
            ("1000h", LONGEST_NS),
        ] {
            assert_eq!(span(text), Some(ns), "{text}");
        }
        for text in
            ["", "s", "2", "2,5s", "-1s", "+1s", ".5s", "1.s", "1 s", "1001h", "1000.1h", "99999999999999999999s"]
        {
            assert_eq!(span(text), None, "{text}");
        }
    }

    #[test]
    fn numbers_are_decimal_or_hexadecimal() {
        for (text, number) in [
            ("12", Some(12)),
            ("0x7500", Some(0x7500)),
            ("0XfF", Some(255)),
            ("+1", None),
            ("0x+1", None),
            ("", None),
            ("0x", None),
        ] {
            assert_eq!(whole(text), number, "{text}");
        }
    }
}
