//! Makes control characters in text visible, so that text from outside cannot control the terminal.
//!
//! Names, links and messages come from recordings, servers, boards and files. The tool writes all its text through
//! this module, so that no verb has to take care of it. A control character, or an invisible one that changes the
//! order of letters, is written as its code, `\u001b`. JSON has the same form for it, so JSON stays valid and keeps
//! its meaning.

use std::io::{self, Write};

/// The largest number of bytes of an incomplete UTF-8 character, which has 4 bytes at most. They are kept until the rest is
/// written.
const PART_MAX: usize = 3;

/// Whether a character is shown as it is, and not as its code.
pub fn is_plain(letter: char) -> bool {
    let unseen =
        matches!(letter, '\u{200B}'..='\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{2066}'..='\u{2069}' | '\u{FEFF}');
    matches!(letter, '\n' | '\t') || !(letter.is_control() || unseen)
}

/// The text with control characters replaced by their codes.
pub fn visible(text: &str) -> String {
    String::from_utf8(visible_bytes(text.as_bytes())).unwrap_or_default()
}

/// As [`visible`], for bytes that may not be UTF-8.
pub fn visible_bytes(bytes: &[u8]) -> Vec<u8> {
    let mut shown = Vec::with_capacity(bytes.len());
    // Writing to memory does not fail.
    let _ = Visible::new(&mut shown).write_all(bytes);
    shown
}

/// A writer that replaces control characters by their codes, and bytes that are not UTF-8 by `\x9b` and the like.
#[derive(Debug)]
pub struct Visible<W: Write> {
    inner: W,
    /// The bytes at the end of the last write that begin a character whose rest is still to come.
    part: Vec<u8>,
}

impl<W: Write> Visible<W> {
    pub const fn new(inner: W) -> Self {
        Self { inner, part: Vec::new() }
    }

    fn text(&mut self, mut text: &str) -> io::Result<()> {
        while let Some(at) = text.find(|letter| !is_plain(letter)) {
            let (plain, rest) = text.split_at(at);
            let mut letters = rest.chars();
            self.inner.write_all(plain.as_bytes())?;
            // Four digits are enough for the code of each of these characters.
            letters.next().map_or(Ok(()), |letter| write!(self.inner, "\\u{:04x}", u32::from(letter)))?;
            text = letters.as_str();
        }
        self.inner.write_all(text.as_bytes())
    }

    fn bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut chunks = bytes.utf8_chunks().peekable();
        while let Some(chunk) = chunks.next() {
            self.text(chunk.valid())?;
            let invalid = chunk.invalid();
            if chunks.peek().is_none() && invalid.len() <= PART_MAX && may_begin(invalid) {
                self.part = invalid.to_vec();
            } else {
                invalid.iter().try_for_each(|byte| write!(self.inner, "\\x{byte:02x}"))?;
            }
        }
        Ok(())
    }
}

/// Whether these bytes may be the beginning of a UTF-8 character whose rest is still to come.
fn may_begin(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).is_err_and(|error| error.error_len().is_none())
}

impl<W: Write> Write for Visible<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.part.is_empty() {
            self.bytes(bytes)?;
        } else {
            let all = [&std::mem::take(&mut self.part), bytes].concat();
            self.bytes(&all)?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every control character is shown by its code; all other text is unchanged.
    #[test]
    fn control_characters_are_shown_by_their_codes() {
        for (text, shown) in [
            ("axis 1: at 5000\n\tßµ漢\u{1F600}", "axis 1: at 5000\n\tßµ漢\u{1F600}"),
            ("\x1b]0;title\x07\x1b[2J", "\\u001b]0;title\\u0007\\u001b[2J"),
            ("over\rwritten\x08", "over\\u000dwritten\\u0008"),
            ("\u{9b}31m \u{7f}\0", "\\u009b31m \\u007f\\u0000"),
            ("\u{202E}reversed\u{2066}\u{200B}\u{FEFF}", "\\u202ereversed\\u2066\\u200b\\ufeff"),
        ] {
            assert_eq!(visible(text), shown);
        }
    }

    /// JSON with control characters stays valid and parses to the same value.
    #[test]
    fn json_with_control_characters_keeps_its_meaning() {
        let text: String = (0..0x300).chain(0x2000..0x2100).filter_map(char::from_u32).collect();
        let json = serde_json::json!({ "text": text, "\u{9b}": "\\\u{7f}" }).to_string();
        let shown = visible(&json);
        assert!(shown.chars().all(is_plain) && !shown.contains(['\n', '\t']));
        let (before, after): (serde_json::Value, serde_json::Value) =
            (serde_json::from_str(&json).expect("JSON"), serde_json::from_str(&shown).expect("JSON"));
        assert_eq!(before, after);
    }

    /// A character that is split between two writes appears as if it had been written at once; bytes that are not UTF-8 are
    /// shown too.
    #[test]
    fn bytes_written_in_pieces_come_out_as_in_one_piece() {
        let bytes = "µ漢\u{1F600}\u{9b}\x1b[0m".as_bytes().iter().copied().chain([0x9b, b'A', 0xC2, b'B', 0xFF, 0xE6]);
        let bytes: Vec<u8> = bytes.collect();
        let expected = "µ漢\u{1F600}\\u009b\\u001b[0m\\x9bA\\xc2B\\xff";
        for size in 1..=bytes.len() {
            let mut shown = Vec::new();
            let mut out = Visible::new(&mut shown);
            bytes.chunks(size).for_each(|piece| out.write_all(piece).expect("memory"));
            assert_eq!(String::from_utf8_lossy(&shown), expected, "{size}");
        }
    }
}
