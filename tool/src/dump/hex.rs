//! Parses frames and packets from hexadecimal digits, one per line: `> 01 00 00 e7 02 ...`.

use ecmsk::link::Dir;
use ecmsk::sk::{FRAME_LEN, Frame, SlotSize};

/// A line of standard input with hexadecimal digits, parsed.
#[derive(Debug, PartialEq, Eq)]
pub struct HexLine {
    /// The bytes. If the number of digits is odd, the last digit is a byte of its own.
    pub bytes: Vec<u8>,
    /// The number of hexadecimal digits on the line.
    digits: usize,
    /// The direction from the prefix of the line: `>` to the board, `<` from it.
    pub direction: Option<Dir>,
}

/// Why a line is not a frame.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum HexError {
    /// A character is neither a digit nor a blank.
    #[error("`{found}` is no hexadecimal digit")]
    NotADigit {
        /// The character that is no hexadecimal digit.
        found: char,
    },
    /// The number of digits is odd, or the number of bytes is not that of a frame.
    #[error("{digits} hexadecimal digits are {half} bytes, expected {FRAME_BYTES_MIN} to {FRAME_LEN} ({} digits to {})", 2 * FRAME_BYTES_MIN, 2 * FRAME_LEN, half = BytesOfDigits(*digits))]
    Length {
        /// The number of digits on the line.
        digits: usize,
    },
}

/// The length in bytes of a frame with 12-byte slots, the shorter of the two frame lengths.
const FRAME_BYTES_MIN: usize = SlotSize::Bytes12.frame_len();

/// Parses a line: an optional `>` or `<`, then digits, with blanks anywhere; `#` starts a comment. Returns `None` for
/// an empty line or a comment.
pub fn parse(line: &str) -> Result<Option<HexLine>, HexError> {
    let line = line.split('#').next().unwrap_or_default().trim();
    let (direction, rest) = match line.split_at_checked(1) {
        Some((">", rest)) => (Some(Dir::Write), rest),
        Some(("<", rest)) => (Some(Dir::Read), rest),
        Some(_) => (None, line),
        None if line.is_empty() => return Ok(None),
        None => (None, line),
    };
    let (mut bytes, mut digits) = (Vec::new(), 0_usize);
    for found in rest.chars().filter(|c| !c.is_whitespace()) {
        let value = found.to_digit(16).ok_or(HexError::NotADigit { found })? as u8;
        match bytes.last_mut() {
            Some(byte) if !digits.is_multiple_of(2) => *byte = *byte << 4 | value,
            _ => bytes.push(value),
        }
        digits += 1;
    }
    Ok(Some(HexLine { bytes, digits, direction }))
}

impl HexLine {
    /// The line as a frame of a board; missing bytes at the end are 0.
    ///
    /// # Errors
    /// [`HexError::Length`] if the number of digits is odd, or if there are too few or too many bytes for a frame.
    pub fn frame(&self) -> Result<Frame, HexError> {
        let is_whole = self.digits.is_multiple_of(2) && (FRAME_BYTES_MIN..=FRAME_LEN).contains(&self.bytes.len());
        if is_whole { Ok(Frame::from_prefix(&self.bytes)) } else { Err(HexError::Length { digits: self.digits }) }
    }

    /// Whether the number of digits is even, so that they form whole bytes.
    pub const fn is_of_bytes(&self) -> bool {
        self.digits.is_multiple_of(2)
    }
}

/// Shows a number of digits as a number of bytes: `12` or `12 and a half`.
struct BytesOfDigits(usize);

impl std::fmt::Display for BytesOfDigits {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{}", self.0 / 2, if self.0.is_multiple_of(2) { "" } else { " and a half" })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// A frame is parsed from its digits, with blanks at any position.
        #[test]
        fn a_frame_comes_back_from_its_digits_wherever_blanks_are(bytes in proptest::collection::vec(any::<u8>(), FRAME_BYTES_MIN..=FRAME_LEN), blank in "[ \t]{0,3}") {
            let digits: String = bytes.iter().map(|byte| format!("{byte:02x}{blank}")).collect();
            for (prefix, direction) in [("", None), ("> ", Some(Dir::Write)), ("<", Some(Dir::Read))] {
                let parsed = parse(&format!(" {prefix}{digits}# comment")).expect("a frame").expect("no empty line");
                prop_assert_eq!(&parsed.bytes, &bytes);
                prop_assert_eq!(parsed.direction, direction);
                prop_assert_eq!(parsed.frame(), Ok(Frame::from_prefix(&bytes)));
            }
        }

        /// No text makes the parser panic.
        #[test]
        fn no_line_makes_the_parser_panic(line in "\\PC*") {
            let _ = parse(&line);
        }
    }
}
