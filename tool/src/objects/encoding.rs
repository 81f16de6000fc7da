//! Decodes an XML file from the encoding in its byte order mark or declaration (XML 1.0, appendix F).

use std::borrow::Cow;

use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE};

/// Why a file cannot be decoded.
#[derive(Debug, thiserror::Error)]
pub enum EncodingError {
    /// The declared encoding is not supported.
    #[error("it declares the encoding `{0}`, which is not known here; save it as UTF-8 with that declaration")]
    Unknown(String),
    /// The bytes are not valid in the encoding.
    #[error(
        "it is no text in {encoding}, which {why}; declare its true encoding, e.g. <?xml version=\"1.0\" \
         encoding=\"windows-1252\"?>"
    )]
    Malformed {
        /// The name of the encoding.
        encoding: &'static str,
        /// Why this encoding was chosen.
        why: &'static str,
    },
}

/// Decodes a file from the encoding of its byte order mark, else from the declared encoding, else from UTF-8.
///
/// # Errors
/// [`EncodingError`] if the declared encoding is unknown, or if the bytes are not valid text in the encoding.
pub fn decoded(bytes: &[u8]) -> Result<Cow<'_, str>, EncodingError> {
    let (encoding, why, text) = match (Encoding::for_bom(bytes), bytes) {
        (Some((encoding, mark)), _) => (encoding, "its byte order mark says", &bytes[mark..]),
        (None, [b'<', 0, ..]) => (UTF_16LE, "its first bytes say", bytes),
        (None, [0, b'<', ..]) => (UTF_16BE, "its first bytes say", bytes),
        (None, _) => match declared(bytes) {
            None => (UTF_8, "XML without a declared encoding is", bytes),
            Some(label) => {
                let known = Encoding::for_label(label);
                let known = known.ok_or_else(|| EncodingError::Unknown(String::from_utf8_lossy(label).into_owned()))?;
                // The declaration was read byte by byte, so the file is not in UTF-16, even if it declares this
                // encoding.
                let known = if [UTF_16LE, UTF_16BE].contains(&known) { UTF_8 } else { known };
                (known, "it declares", bytes)
            }
        },
    };
    let text = encoding.decode_without_bom_handling_and_without_replacement(text);
    text.ok_or(EncodingError::Malformed { encoding: encoding.name(), why })
}

/// The name of the encoding in the XML declaration.
fn declared(bytes: &[u8]) -> Option<&[u8]> {
    let rest = bytes.strip_prefix(b"<?xml")?;
    let end = rest.windows(2).position(|pair| pair == b"?>")?;
    let declaration = &rest[..end];
    let name = b"encoding";
    let at = declaration.windows(name.len()).position(|word| word == name)?;
    let value = declaration[at + name.len()..].trim_ascii_start().strip_prefix(b"=")?.trim_ascii_start();
    let (quote, value) = value.split_first()?;
    let end = value.iter().position(|byte| byte == quote)?;
    (*quote == b'"' || *quote == b'\'').then_some(&value[..end])
}

#[cfg(test)]
mod tests {
    use super::*;

    const BODY: &str = "<a>Pr\u{FC}fwerk 1\u{B5}s</a>";

    fn utf_16(text: &str, to_bytes: fn(u16) -> [u8; 2]) -> Vec<u8> {
        text.encode_utf16().flat_map(to_bytes).collect()
    }

    /// A byte order mark takes precedence over the declaration, and the declaration over UTF-8. A declaration of UTF-16
    /// that can be read byte by byte is ignored.
    #[test]
    fn a_text_is_read_in_its_encoding() {
        let with = |label: &str| format!("<?xml version='1.0' encoding = \"{label}\"?>\n{BODY}");
        let latin = |text: &str| text.chars().map(|c| c as u8).collect::<Vec<u8>>();
        let marked = |mark: &[u8], text: Vec<u8>| [mark, &text].concat();
        let (le, be) = (u16::to_le_bytes as fn(u16) -> [u8; 2], u16::to_be_bytes as fn(u16) -> [u8; 2]);
        for bytes in [
            BODY.as_bytes().to_vec(),
            with("UTF-8").into_bytes(),
            with("utf-16").into_bytes(),
            latin(&with("ISO-8859-1")),
            latin(&with("iso-8859-15")),
            latin(&with("windows-1252")),
            marked(b"\xEF\xBB\xBF", with("ISO-8859-1").into_bytes()),
            marked(b"\xFF\xFE", utf_16(&with("UTF-16"), le)),
            marked(b"\xFE\xFF", utf_16(&with("UTF-16"), be)),
            utf_16(&with("UTF-16"), le),
            utf_16(&with("UTF-16BE"), be),
        ] {
            let text = decoded(&bytes).unwrap_or_else(|why| panic!("{:?}: {why}", String::from_utf8_lossy(&bytes)));
            // The byte 0xB5 before the `s` is not compared, because it is a micro sign in ISO-8859-1 and another
            // character in ISO-8859-15.
            assert!(text.contains("Pr\u{FC}fwerk 1") && text.ends_with("s</a>"), "{text}");
        }
        let cp1252 = decoded(b"<?xml version=\"1.0\" encoding=\"cp1252\"?><a>\x80</a>").unwrap();
        assert!(cp1252.ends_with("<a>\u{20AC}</a>"));
    }

    /// A file that is not in its declared encoding is refused, and the error says what the user can do.
    #[test]
    fn a_wrong_encoding_is_told() {
        let unknown = decoded(b"<?xml version=\"1.0\" encoding=\"klingon\"?><a/>").unwrap_err().to_string();
        assert!(unknown.contains("`klingon`") && unknown.contains("save it as UTF-8"), "{unknown}");
        for bytes in [&b"<?xml version=\"1.0\" encoding=\"UTF-8\"?><a>\xFC</a>"[..], b"<a>\xFC</a>", b"\xFF\xFE<"] {
            let wrong = decoded(bytes).unwrap_err().to_string();
            assert!(
                wrong.starts_with("it is no text in UTF-") && wrong.contains("declare its true encoding"),
                "{wrong}"
            );
        }
    }
}
