//! Frames as hexadecimal digits, one on a line: `> 01 00 00 e7 02 ...`.

use ecmsk::link::Dir;
use ecmsk::sk::{FRAME_LEN, Frame, SlotSize};

/// A frame as it stood on a line.
#[derive(Debug, PartialEq, Eq)]
pub struct HexFrame {
    /// The frame; what the line does not have is 0.
    pub frame: Frame,
    /// Bytes on the line, 504..=512.
    pub len: usize,
    /// From the prefix: `>` to the board, `<` from it.
    pub direction: Option<Dir>,
}

/// Why a line is no frame.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum HexError {
    /// Neither a digit nor a blank.
    #[error("`{found}` is no hexadecimal digit")]
    NotADigit {
        /// The character.
        found: char,
    },
    /// No frame has that length.
    #[error("{digits} hexadecimal digits are {half} bytes, expected {SHORTEST} to {FRAME_LEN} ({} digits to {})", 2 * SHORTEST, 2 * FRAME_LEN, half = Bytes(*digits))]
    Length {
        /// Digits on the line.
        digits: usize,
    },
}

/// Bytes of the shorter frame.
const SHORTEST: usize = SlotSize::Bytes12.frame_len();

/// The frame on a line: an optional `>` or `<`, then digits, with blanks wherever; `#` starts a comment. `None`: the
/// line has nothing but blanks and a comment.
pub fn parse(line: &str) -> Result<Option<HexFrame>, HexError> {
    let line = line.split('#').next().unwrap_or_default().trim();
    let (direction, rest) = match line.split_at_checked(1) {
        Some((">", rest)) => (Some(Dir::Write), rest),
        Some(("<", rest)) => (Some(Dir::Read), rest),
        Some(_) => (None, line),
        None if line.is_empty() => return Ok(None),
        None => (None, line),
    };
    let mut frame = Frame::new();
    let mut digits = 0;
    for found in rest.chars().filter(|c| !c.is_whitespace()) {
        let value = found.to_digit(16).ok_or(HexError::NotADigit { found })? as u8;
        if let Some(byte) = frame.bytes_mut().get_mut(digits / 2) {
            *byte = *byte << 4 | value;
        }
        digits += 1;
    }
    if !digits.is_multiple_of(2) || !(SHORTEST..=FRAME_LEN).contains(&(digits / 2)) {
        return Err(HexError::Length { digits });
    }
    Ok(Some(HexFrame { frame, len: digits / 2, direction }))
}

/// Bytes that so many digits make, `12` or `12 and a half`.
struct Bytes(usize);

impl std::fmt::Display for Bytes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{}", self.0 / 2, if self.0.is_multiple_of(2) { "" } else { " and a half" })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Any bytes of a frame come back from their digits, wherever blanks stand.
        #[test]
        fn a_frame_comes_back_from_its_digits_wherever_blanks_are(bytes in proptest::collection::vec(any::<u8>(), SHORTEST..=FRAME_LEN), blank in "[ \t]{0,3}") {
            let digits: String = bytes.iter().map(|byte| format!("{byte:02x}{blank}")).collect();
            for (prefix, direction) in [("", None), ("> ", Some(Dir::Write)), ("<", Some(Dir::Read))] {
                let parsed = parse(&format!(" {prefix}{digits}# comment")).expect("a frame").expect("no empty line");
                prop_assert_eq!(parsed.len, bytes.len());
                prop_assert_eq!(parsed.direction, direction);
                prop_assert_eq!(parsed.frame, Frame::from_prefix(&bytes));
            }
        }

        /// Any line is a frame, nothing or an error.
        #[test]
        fn no_line_makes_the_parser_panic(line in "\\PC*") {
            let _ = parse(&line);
        }
    }
}
