//! Converts bytes to hexadecimal digits and back.

use std::fmt::Write;

/// The bytes without anything between them: `0102FF`.
pub fn hex(bytes: &[u8]) -> String {
    joined(bytes, "")
}

/// The bytes with spaces between them: `01 02 FF`.
pub fn spaced(bytes: &[u8]) -> String {
    if bytes.is_empty() { "no bytes".to_owned() } else { joined(bytes, " ") }
}

fn joined(bytes: &[u8], between: &str) -> String {
    bytes.iter().enumerate().fold(String::new(), |mut text, (n, byte)| {
        // Writing to a String does not fail.
        let _ = write!(text, "{}{byte:02X}", if n > 0 { between } else { "" });
        text
    })
}

/// Parses `0102FF`; spaces and colons between bytes are ignored.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn parse_hex(text: &str) -> Result<Vec<u8>, String> {
    let wrong = || "allowed: bytes of two hexadecimal digits each, e.g. 0102FF".to_owned();
    let digits: Vec<u32> = text
        .chars()
        .filter(|c| !matches!(c, ' ' | ':'))
        .map(|c| c.to_digit(16).ok_or_else(wrong))
        .collect::<Result<_, _>>()?;
    let (bytes, rest) = digits.as_chunks::<2>();
    if bytes.is_empty() || !rest.is_empty() {
        return Err(wrong());
    }
    Ok(bytes.iter().map(|[high, low]| (high << 4 | low) as u8).collect())
}
