//! Decodes the bytes that a terminal sends: keys, and answers to [`ASK`](super::terminal::ASK).
//!
//! The terminal library discards these answers, but they are needed to measure how late keys arrive. So this module
//! decodes the few sequences that `jog` needs. Any other sequence counts as a key that moves no axis.

use ratatui::crossterm::event::KeyCode;

use super::terminal::Token;

const ESC: u8 = 0x1b;
const CTRL_C: u8 = 3;
/// A key that moves no axis.
const OTHER: Token = Token::Key { code: KeyCode::Null, is_release: false };

/// The bytes that have arrived and are not decoded yet. The last sequence may be incomplete.
#[derive(Debug, Default)]
pub struct Decoder(Vec<u8>);

impl Decoder {
    pub fn add(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    /// Whether an incomplete sequence is buffered.
    pub fn waits(&self) -> bool {
        !self.0.is_empty()
    }

    /// Removes and returns the next token; `None` if no token has arrived completely.
    pub fn take(&mut self) -> Option<Token> {
        let (token, length) = first(&self.0)?;
        self.0.drain(..length);
        Some(token)
    }

    /// Ends an incomplete sequence, because no more bytes have come in time: a lone ESC byte is the key Esc.
    pub fn end(&mut self) -> Option<Token> {
        match std::mem::take(&mut self.0)[..] {
            [] => None,
            [ESC] => Some(key(KeyCode::Esc)),
            _ => Some(OTHER),
        }
    }
}

const fn key(code: KeyCode) -> Token {
    Token::Key { code, is_release: false }
}

/// The first token of `bytes` and its length in bytes; `None` if the token is incomplete.
fn first(bytes: &[u8]) -> Option<(Token, usize)> {
    match *bytes {
        [] | [ESC] | [ESC, b'O'] => None,
        [ESC, b'[', ref rest @ ..] => {
            let end = rest.iter().position(|byte| !(b' '..=b'?').contains(byte))?;
            match rest[end] {
                last @ b'@'..=b'~' => Some((control_sequence(&rest[..end], last), end + 3)),
                // This byte cannot be in the sequence, so the sequence was cut off.
                _ => Some((OTHER, end + 2)),
            }
        }
        [ESC, b'O', last, ..] => Some((key(arrow(last)), 3)),
        [ESC, ESC, ..] => Some((key(KeyCode::Esc), 1)),
        [ESC, _, ..] => Some((OTHER, 2)),
        [CTRL_C, ..] => Some((Token::Interrupt, 1)),
        [byte @ b' '..=b'~', ..] => Some((key(KeyCode::Char(byte.into())), 1)),
        [_, ..] => Some((OTHER, 1)),
    }
}

const fn arrow(last: u8) -> KeyCode {
    match last {
        b'A' => KeyCode::Up,
        b'B' => KeyCode::Down,
        b'C' => KeyCode::Right,
        b'D' => KeyCode::Left,
        _ => KeyCode::Null,
    }
}

/// Decodes a sequence `ESC [ PARAMETERS LAST`. With kitty's protocol the second parameter contains the modifiers and,
/// after a colon, whether the key was pressed, repeated (2) or released (3). If `LAST` is `u`, the first parameter is
/// the number of the key.
fn control_sequence(parameters: &[u8], last: u8) -> Token {
    const CONTROL: u32 = 4;
    let number = |field, part| -> Option<u32> {
        let field = parameters.split(|byte| *byte == b';').nth(field)?;
        std::str::from_utf8(field.split(|byte| *byte == b':').nth(part)?).ok()?.parse().ok()
    };
    let is_release = number(1, 1) == Some(3);
    let modifiers = number(1, 0).unwrap_or(1).saturating_sub(1);
    let code = match (last, number(0, 0)) {
        (b'n', Some(0 | 3)) => return Token::Answer,
        (b'u', Some(99)) if modifiers & CONTROL != 0 && !is_release => return Token::Interrupt,
        (b'u', Some(27)) => KeyCode::Esc,
        (b'u', Some(57412)) => KeyCode::Char('-'),
        (b'u', Some(57413)) => KeyCode::Char('+'),
        (b'u', Some(57415)) => KeyCode::Char('='),
        (b'u', Some(57417)) => KeyCode::Left,
        (b'u', Some(57418)) => KeyCode::Right,
        (b'u', Some(57419)) => KeyCode::Up,
        (b'u', Some(57420)) => KeyCode::Down,
        (b'u', Some(code @ 32..=126)) => char::from_u32(code).map_or(KeyCode::Null, KeyCode::Char),
        (b'u', _) => KeyCode::Null,
        _ => arrow(last),
    };
    Token::Key { code, is_release }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn tokens(bytes: &[u8]) -> Vec<Token> {
        let mut decoder = Decoder::default();
        decoder.add(bytes);
        std::iter::from_fn(|| decoder.take()).collect()
    }

    /// The keys that move axes or end jogging, as terminals send them: with and without kitty's protocol, and with
    /// answers between them.
    #[test]
    fn keys_are_told_from_answers() {
        let right = key(KeyCode::Right);
        let released = Token::Key { code: KeyCode::Right, is_release: true };
        assert_eq!(tokens(b"\x1b[C\x1b[0n\x1bOC\x1b[1;1:2C"), [right, Token::Answer, right, right]);
        assert_eq!(tokens(b"\x1b[A\x1b[B\x1b[D").len(), 3);
        assert_eq!(tokens(b"\x1b[1;1:3C\x1b[57418;1:3u"), [released; 2]);
        assert_eq!(tokens(b"+-q"), ['+', '-', 'q'].map(|c| key(KeyCode::Char(c))));
        assert_eq!(tokens(b"\x1b[43u\x1b[27u"), [key(KeyCode::Char('+')), key(KeyCode::Esc)]);
        assert_eq!(tokens(b"\x03\x1b[99;5u"), [Token::Interrupt; 2]);
        assert_eq!(tokens(b"\x1b[3n"), [Token::Answer]);
    }

    /// Every other key moves nothing, and so stops the axes: the tab key, Ctrl-\, a non-ASCII letter, F5, a cut
    /// sequence, Alt.
    #[test]
    fn all_else_stops() {
        for bytes in [b"\t" as &[u8], b"\x1c", b"\x7f", b"\x1b[15~", b"\x1b[?1;2c", b"\x1bx", b"\x1b[I"] {
            assert_eq!(tokens(bytes), [OTHER], "{bytes:?}");
        }
        assert_eq!(tokens("ä".as_bytes()), [OTHER; 2]);
        assert_eq!(tokens(b"\x1b[1;\x1b[C"), [OTHER, key(KeyCode::Right)]);
    }

    /// A sequence may arrive in parts. If nothing follows the byte ESC, it is the key Esc.
    #[test]
    fn a_sequence_may_come_in_parts() {
        let mut decoder = Decoder::default();
        for part in [b"\x1b" as &[u8], b"[", b"0"] {
            decoder.add(part);
            assert!(decoder.take().is_none() && decoder.waits());
        }
        decoder.add(b"n\x1b");
        assert_eq!((decoder.take(), decoder.take(), decoder.waits()), (Some(Token::Answer), None, true));
        assert_eq!((decoder.end(), decoder.end()), (Some(key(KeyCode::Esc)), None));
        decoder.add(b"\x1b[1");
        assert_eq!((decoder.take(), decoder.end(), decoder.waits()), (None, Some(OTHER), false));
    }

    proptest! {
        /// Any bytes are decoded to tokens, however they are split, and no byte stays in the decoder for ever.
        #[test]
        fn any_bytes_become_tokens(parts in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..9), 0..9)) {
            let mut decoder = Decoder::default();
            for part in parts {
                decoder.add(&part);
                while decoder.take().is_some() {}
            }
            decoder.end();
            prop_assert!(!decoder.waits());
        }
    }
}
