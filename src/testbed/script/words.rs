//! Splits a line of a script into words, and reads times and numbers.

use crate::address::Fraction;
use crate::address::text::{decimal, suggestion};
use crate::fieldbus::Ns;

/// Why a line is invalid: the column in characters, from 1, and the message.
pub(super) type LineError = (usize, String);

/// The words of a line that have not been read yet.
pub(super) struct Words<'a> {
    line: &'a str,
    /// The byte position at which the search for the next word begins.
    at: usize,
}

/// A word and its column in characters, from 1.
#[derive(Clone, Copy)]
pub(super) struct Word<'a> {
    pub(super) text: &'a str,
    pub(super) column: usize,
}

impl Word<'_> {
    pub(super) fn wrong(&self, is: &str, allowed: &str) -> LineError {
        (self.column, format!("`{}` is {is}; allowed: {allowed}", self.text))
    }

    /// The error for a word that is not among the `known` ones, with a suggestion if one of them is similar. `what` is the kind
    /// of word that is expected.
    pub(super) fn unknown(&self, what: &str, known: &[&'static str]) -> LineError {
        let suggestion = suggestion(self.text, known.iter().copied());
        (self.column, format!("`{}` is no {what};{suggestion} allowed: {}", self.text, known.join(", ")))
    }
}

impl<'a> Words<'a> {
    /// Splits a line into words, without its comment.
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

    /// Takes the next word. If there is none, the error names the missing operand `what` and the syntax `form` of the verb.
    pub(super) fn need(&mut self, what: &str, form: &str) -> Result<Word<'a>, LineError> {
        let end = 1 + self.line.trim_end().chars().count();
        self.next().ok_or_else(|| (end, format!("{what} is missing; allowed: {form}")))
    }

    /// Takes the next word if it is `text`; returns whether it was.
    pub(super) fn take(&mut self, text: &str) -> bool {
        let found = self.peek().is_some_and(|word| word.text == text);
        if found {
            self.next();
        }
        found
    }
}

const TIMES: &str = "a time with its unit, such as 2.5s; units: us, ms, s, min, h; at most 1000h";
/// The units of time. A word is matched by its suffix, so `us` and `ms` come before `s`.
const UNITS: [(&str, Ns); 5] =
    [("us", 1_000), ("ms", 1_000_000), ("min", 60_000_000_000), ("s", 1_000_000_000), ("h", 3_600_000_000_000)];
/// The longest time in a script, 1000 hours \[OURS].
const TIME_MAX_NS: Ns = 1000 * 3_600_000_000_000;

/// Takes the next word as a duration, exact to the nanosecond.
pub(super) fn time(words: &mut Words, form: &str) -> Result<Ns, LineError> {
    let word = words.need("TIME", form)?;
    span(word.text).ok_or_else(|| word.wrong("no time", TIMES))
}

fn span(text: &str) -> Option<Ns> {
    let (number, unit) = UNITS.iter().find_map(|(name, ns)| Some((text.strip_suffix(name)?, *ns)))?;
    let (whole, decimals) = number.split_once('.').unwrap_or((number, "0"));
    let part = Fraction::parse(&format!("0.{decimals}"))?;
    let part = u128::from(part.billionths()) * u128::from(unit) / u128::from(Fraction::ONE.billionths());
    let ns = decimal(whole)?.checked_mul(unit)?.checked_add(part as Ns)?;
    (ns <= TIME_MAX_NS).then_some(ns)
}

/// Parses an unsigned integer in decimal, or in hexadecimal after `0x`.
pub(super) fn whole(text: &str) -> Option<u64> {
    let (digits, radix) = match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => (digits, 16),
        None => (text, 10),
    };
    // `from_str_radix` alone would accept a plus sign.
    let plain = digits.bytes().all(|byte| byte.is_ascii_alphanumeric());
    u64::from_str_radix(digits, radix).ok().filter(|_| plain)
}

/// Takes the next word as an integer from `least` to `most`.
pub(super) fn number(words: &mut Words, what: &str, form: &str, least: u64, most: u64) -> Result<u64, LineError> {
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
            ("1000h", TIME_MAX_NS),
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
