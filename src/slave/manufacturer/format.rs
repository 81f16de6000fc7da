//! The text format of manufacturer-specific objects: one object per line, `INDEX:SUB TYPE ACCESS [MAPPING] VALUE NAME`.

use std::fmt::{self, Write as _};

use super::{
    MANUFACTURER_VALUE_BYTES_MAX, ManufacturerObject, ManufacturerObjects, ManufacturerType, ManufacturerValue,
    Mappable,
};
use crate::ethercat::coe::ObjectAddress;
use crate::slave::dictionary::Access;

/// The maximum size of a file with manufacturer-specific objects, bytes \[OURS]: about 50,000 lines.
pub const MANUFACTURER_FILE_BYTES_MAX: u64 = 4 << 20;

/// The syntax of a line, for error messages.
const FORM: &str = "a line is INDEX:SUB TYPE ACCESS VALUE NAME, e.g. `0x2101:1 u16 rw 0x0010 Motor code`";

/// The maximum length of a value that is written as a number, bytes; a longer value is written in quotes.
const NUMBER_BYTES_MAX: usize = size_of::<u64>();

/// Why a text is not a valid list of objects.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {message}; {FORM}")]
pub struct FormatError {
    /// The line, from 1.
    pub line: usize,
    /// The mistake, and what is allowed instead.
    pub message: String,
}

impl ManufacturerObjects {
    /// Parses a text with one object per line: `INDEX:SUB TYPE ACCESS [MAPPING] VALUE NAME`.
    ///
    /// - `INDEX:SUB`: hexadecimal with 0x, or decimal: `0x2101:1`.
    /// - `TYPE`: `bool`, `i8`, `u8`, `i16`, `u16`, `i32`, `u32`, `f32`, `i64`, `u64`, `f64`, `text`, or `any` for a value
    ///   of unknown size.
    /// - `ACCESS`: `ro`, `rw` or `wo`.
    /// - `MAPPING`: `rx`, `tx` or `rxtx` for an object that can be mapped into RxPDOs (outputs), TxPDOs (inputs) or both;
    ///   left out for an object that cannot be mapped.
    /// - `VALUE`: a number; with 0x, the bytes in SDO order. `-` stands for 0. For `text` and `any` also the bytes in
    ///   double quotes, where `\` escapes `"` and `\`, and `\xE9` is the byte 0xE9. Non-ASCII characters are encoded in
    ///   ISO-8859-1, or in UTF-8 if ISO-8859-1 does not have them.
    /// - `NAME`: the rest of the line, a descriptive name; may be left out.
    ///
    /// `#` at the beginning of a line begins a comment. Each address may appear only once.
    ///
    /// # Errors
    /// [`FormatError`] for the first line that does not have this form or repeats an address.
    pub fn parse(text: &str) -> Result<Self, FormatError> {
        let mut objects = Vec::new();
        let mut lines = std::collections::HashMap::new();
        // Some editors on Windows begin a file with a byte order mark, which is skipped.
        for (line, text) in (1..).zip(text.strip_prefix('\u{FEFF}').unwrap_or(text).lines()) {
            let text = text.trim();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let object = object(text).map_err(|message| FormatError { line, message })?;
            if let Some(first) = lines.insert(object.address, line) {
                let message = format!("{} stands in line {first} already; leave one of them out", object.address);
                return Err(FormatError { line, message });
            }
            objects.push(object);
        }
        Ok(Self::of(objects))
    }
}

fn object(text: &str) -> Result<ManufacturerObject, String> {
    let (place, rest) = word(text);
    let (index, sub) = place.split_once(':').ok_or_else(|| format!("`{place}` is no INDEX:SUB, e.g. 0x2101:1"))?;
    let index = whole(index).and_then(|index| u16::try_from(index).ok());
    let sub = whole(sub).and_then(|sub| u8::try_from(sub).ok());
    let (Some(index), Some(sub)) = (index, sub) else {
        return Err(format!("`{place}` is no INDEX:SUB; allowed: 0x0000:0 to 0xFFFF:255"));
    };
    let (kind, rest) = word(rest);
    let data = ManufacturerType::ALL.into_iter().find(|data| data.word() == kind).ok_or_else(|| {
        format!("`{kind}` is no TYPE; allowed: {}", ManufacturerType::ALL.map(ManufacturerType::word).join(", "))
    })?;
    let (access, rest) = word(rest);
    let access = match access {
        "ro" => Access::ReadOnly,
        "rw" => Access::ReadWrite,
        "wo" => Access::WriteOnly,
        other => return Err(format!("`{other}` is no ACCESS; allowed: ro, rw, wo")),
    };
    let (mapping, behind) = word(rest);
    let mappable = [(true, false), (false, true), (true, true)].map(|(rx, tx)| Mappable { rx, tx });
    let (mappable, rest) = match mappable.into_iter().find(|mappable| mappable.word() == Some(mapping)) {
        Some(mappable) => (mappable, behind),
        None => (Mappable::default(), rest),
    };
    let (value, name) = match rest.strip_prefix('"') {
        Some(quoted) if data.bytes().is_none() => {
            let (bytes, name) = quoted_bytes(quoted)?;
            (ManufacturerValue::of_bytes(&bytes), name)
        }
        _ => {
            let (value, name) = word(rest);
            (number(data, value)?, name)
        }
    };
    let address = ObjectAddress::new(index, sub);
    Ok(ManufacturerObject { address, data, access, mappable, value, name: name.to_owned() })
}

fn number(data: ManufacturerType, value: &str) -> Result<ManufacturerValue, String> {
    let bits = bits(data, value).ok_or_else(|| {
        let (bytes, quotes) = match data.bytes() {
            Some(bytes) => (format!("{bytes} bytes"), ""),
            None => (format!("{NUMBER_BYTES_MAX} bytes at most"), ", in double quotes more of them"),
        };
        format!(
            "`{value}` is no VALUE of type {}; allowed: a number of {bytes}, with 0x its bytes{quotes}, or -",
            data.word()
        )
    })?;
    // The value of a `text` or `any` object as a number, `0x4241` for "AB": the bytes in SDO order, the lowest first.
    // The value ends with the highest byte that is not 0.
    let significant = significant_bytes(bits);
    let bytes = match (data, data.bytes()) {
        (_, Some(bytes)) => bytes.into(),
        (ManufacturerType::Any, None) => significant.max(super::ANY_BYTES_MIN),
        (_, None) => significant,
    };
    Ok(ManufacturerValue::of_bits(bits, bytes))
}

/// The number of bytes of a number up to its highest byte that is not 0.
const fn significant_bytes(bits: u64) -> usize {
    NUMBER_BYTES_MAX - bits.leading_zeros() as usize / 8
}

/// Parses a value in quotes, whose opening quote was already taken. Returns its bytes and the rest of the line.
fn quoted_bytes(text: &str) -> Result<(Vec<u8>, &str), String> {
    let mut bytes = Vec::new();
    let mut letters = text.char_indices();
    while let Some((at, letter)) = letters.next() {
        match letter {
            '"' => {
                if bytes.len() > MANUFACTURER_VALUE_BYTES_MAX {
                    return Err(format!(
                        "the VALUE has {} bytes; allowed: {MANUFACTURER_VALUE_BYTES_MAX}",
                        bytes.len()
                    ));
                }
                return Ok((bytes, text[at + 1..].trim_start()));
            }
            '\\' => match letters.next() {
                Some((_, letter @ ('"' | '\\'))) => bytes.push(letter as u8),
                Some((at, 'x')) => {
                    let digits =
                        text.get(at + 1..at + 3).filter(|digits| digits.bytes().all(|c| c.is_ascii_hexdigit()));
                    let byte = digits.and_then(|digits| u8::from_str_radix(digits, 16).ok());
                    bytes.push(byte.ok_or("behind \\x stand two hexadecimal digits, e.g. \\xE9")?);
                    letters.nth(1);
                }
                _ => return Err("behind \\ stands \", \\ or x with two digits, e.g. \\xE9".to_owned()),
            },
            letter => match u8::try_from(letter) {
                Ok(byte) => bytes.push(byte),
                Err(_) => bytes.extend_from_slice(letter.encode_utf8(&mut [0; 4]).as_bytes()),
            },
        }
    }
    Err("the VALUE has no second double quote".to_owned())
}

/// Writes the object as a line of the text format, see [`ManufacturerObjects::parse`].
impl fmt::Display for ManufacturerObject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let access = match self.access {
            Access::ReadOnly => "ro",
            Access::WriteOnly => "wo",
            Access::ReadWrite | Access::ReadWriteUpTo(_) => "rw",
        };
        let ObjectAddress { index, sub } = self.address;
        write!(f, "0x{index:04X}:{sub} {} {access} ", self.data.word())?;
        if let Some(mapping) = self.mappable.word() {
            write!(f, "{mapping} ")?;
        }
        let bytes = self.value.bytes();
        // Leading zeros of a number are not kept, so a value without a fixed size that ends with zero bytes is written in
        // quotes.
        let is_number = match self.data {
            ManufacturerType::Text => bytes.len() <= NUMBER_BYTES_MAX && bytes.last() != Some(&0),
            ManufacturerType::Any => bytes.len() == significant_bytes(self.value.bits()).max(super::ANY_BYTES_MIN),
            _ => true,
        };
        if is_number {
            write!(f, "0x{:X}", self.value.bits())?;
        } else {
            write_quoted(f, bytes)?;
        }
        let name = self.name.replace(|c: char| c.is_control(), " ");
        match name.trim() {
            "" => Ok(()),
            name => write!(f, " {name}"),
        }
    }
}

fn write_quoted(f: &mut fmt::Formatter<'_>, bytes: &[u8]) -> fmt::Result {
    f.write_char('"')?;
    for byte in bytes {
        match byte {
            b'"' | b'\\' => write!(f, "\\{}", char::from(*byte))?,
            b' '..=b'~' => f.write_char((*byte).into())?,
            byte => write!(f, "\\x{byte:02X}")?,
        }
    }
    f.write_char('"')
}

/// Splits a line after its first word, at white space. Returns the word and the rest.
fn word(text: &str) -> (&str, &str) {
    let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, rest.trim_start())
}

/// Parses an unsigned integer, hexadecimal with 0x. `None`: the text is no such number.
fn whole(text: &str) -> Option<u64> {
    let (digits, radix) = text.strip_prefix("0x").or(text.strip_prefix("0X")).map_or((text, 10), |hex| (hex, 16));
    // `from_str_radix` alone would accept a plus sign, so the characters are checked too.
    let plain = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    u64::from_str_radix(digits, radix).ok().filter(|_| plain)
}

/// Parses a value; the result has the bytes of the SDO value, the first one lowest. `None` if the text is not a value of this
/// data type.
fn bits(data: ManufacturerType, value: &str) -> Option<u64> {
    let width = u32::from(data.bytes().unwrap_or(8)) * 8;
    let mask = u64::MAX >> (64 - width);
    if value == "-" {
        return Some(0);
    }
    let is_hex = value.starts_with("0x") || value.starts_with("0X");
    match data {
        _ if is_hex => whole(value).filter(|bits| bits & !mask == 0),
        ManufacturerType::F32 => value.parse::<f32>().ok().filter(|x| x.is_finite()).map(|x| x.to_bits().into()),
        ManufacturerType::F64 => value.parse::<f64>().ok().filter(|x| x.is_finite()).map(f64::to_bits),
        ManufacturerType::I8 | ManufacturerType::I16 | ManufacturerType::I32 | ManufacturerType::I64 => {
            let number = value.parse::<i64>().ok().filter(|_| !value.starts_with('+'))?;
            let half = i128::from(mask / 2) + 1;
            (-half..half).contains(&i128::from(number)).then_some(number as u64 & mask)
        }
        ManufacturerType::Bool => whole(value).filter(|bits| *bits <= 1),
        _ => whole(value).filter(|bits| bits & !mask == 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SK-7.46 The valid forms of a line, which are read and written without loss.
    #[test]
    fn lines() {
        for (line, bits, written) in [
            ("0x2000:0 u16 rw 18 Motor", 18, "0x2000:0 u16 rw 0x12 Motor"),
            ("8192:255 i8 ro -1", 0xFF, "0x2000:255 i8 ro 0xFF"),
            ("0x2101:1 i32 wo -2147483648   Two  words ", 0x8000_0000, "0x2101:1 i32 wo 0x80000000 Two  words"),
            ("0x2101:2 u64 ro 0xFFFFFFFFFFFFFFFF x", u64::MAX, "0x2101:2 u64 ro 0xFFFFFFFFFFFFFFFF x"),
            ("0x2101:3 f32 rw 1.5 x", 0x3FC0_0000, "0x2101:3 f32 rw 0x3FC00000 x"),
            ("0x2101:4 f64 rw -0.5", 0xBFE0_0000_0000_0000, "0x2101:4 f64 rw 0xBFE0000000000000"),
            ("0x2101:5 text ro 0x454D4341 Maker", 0x454D_4341, "0x2101:5 text ro 0x454D4341 Maker"),
            ("0x2101:6 any rw - x", 0, "0x2101:6 any rw 0x0 x"),
            ("0x2101:7 bool rw 1", 1, "0x2101:7 bool rw 0x1"),
            ("0x2101:8 u32 rw rx 1 Out", 1, "0x2101:8 u32 rw rx 0x1 Out"),
            ("0x2101:9 u8 ro tx - tx", 0, "0x2101:9 u8 ro tx 0x0 tx"),
            ("0x2101:10 i16 rw rxtx -1", 0xFFFF, "0x2101:10 i16 rw rxtx 0xFFFF"),
        ] {
            let read = object(line.trim()).unwrap_or_else(|why| panic!("{line}: {why}"));
            assert_eq!((read.value.bits(), read.to_string().as_str()), (bits, written), "{line}");
            assert_eq!(object(written).as_ref(), Ok(&read), "{line}");
        }
    }

    /// SK-7.46 A text of any length is read and written in quotes, with all its bytes.
    #[test]
    fn texts() {
        let long = "x".repeat(1000);
        for (value, bytes, written) in [
            (r#""twenty-four letters long""#, &b"twenty-four letters long"[..], r#""twenty-four letters long""#),
            (r#""a \"b\" \\ c d""#, br#"a "b" \ c d"#, r#""a \"b\" \\ c d""#),
            (r#""Pr\xFCfwerk 1""#, b"Pr\xFCfwerk 1", r#""Pr\xFCfwerk 1""#),
            ("\"Prüfwerk 1\"", b"Pr\xFCfwerk 1", r#""Pr\xFCfwerk 1""#),
            (r#""ACME""#, b"ACME", "0x454D4341"),
            (r#""AC\x00""#, b"AC\0", r#""AC\x00""#),
            (r#""""#, b"", "0x0"),
            (&format!("\"{long}\""), long.as_bytes(), &format!("\"{long}\"")),
        ] {
            for kind in ["text", "any"] {
                let read = object(&format!("0x2010:0 {kind} rw {value} A  name"))
                    .unwrap_or_else(|why| panic!("{value}: {why}"));
                assert_eq!((read.value.bytes(), read.name.as_str()), (bytes, "A  name"), "{value}");
                if kind == "text" {
                    assert_eq!(read.to_string(), format!("0x2010:0 text rw {written} A  name"));
                }
                let again = object(&read.to_string()).unwrap_or_else(|why| panic!("{read}: {why}"));
                assert_eq!(again.to_string(), read.to_string());
            }
        }
    }

    /// SK-7.46 An error names the line, the mistake and what is allowed.
    #[test]
    fn wrong_lines() {
        for (line, words) in [
            ("0x2000 u16 rw 1", "no INDEX:SUB"),
            ("0x20000:0 u16 rw 1", "0xFFFF:255"),
            ("0x2000:256 u16 rw 1", "0xFFFF:255"),
            ("0x+1:0 u16 rw 1", "no INDEX:SUB"),
            ("0x2000:0 u17 rw 1", "no TYPE; allowed: bool, i8"),
            ("0x2000:0", "no TYPE"),
            ("0x2000:0 u16 rx 1", "no ACCESS; allowed: ro, rw, wo"),
            ("0x2000:0 u16 rw", "no VALUE"),
            ("0x2000:0 u16 rw 65536", "2 bytes"),
            ("0x2000:0 i8 rw -129", "1 bytes"),
            ("0x2000:0 u16 rw -1", "no VALUE"),
            ("0x2000:0 bool rw 2", "no VALUE"),
            ("0x2000:0 f32 rw inf", "no VALUE"),
            ("0x2000:0 text rw \"open", "no second double quote"),
            ("0x2000:0 text rw \"\\q\"", "two digits"),
            ("0x2000:0 text rw \"\\xG1\"", "two hexadecimal digits"),
            ("0x2000:0 u16 rw \"ab\"", "no VALUE"),
            ("0x2000:0 u16 rw xr 1", "no VALUE"),
        ] {
            let error = ManufacturerObjects::parse(&format!("# remark\n\n{line}\n")).unwrap_err();
            assert!(error.line == 3 && error.message.contains(words), "{line}: {error}");
            assert!(error.to_string().starts_with("line 3: ") && error.to_string().contains("e.g. `0x2101:1"));
        }
        let twice = ManufacturerObjects::parse("0x2000:0 u8 rw 1\r\n0x2000:0 u8 rw 2\r\n").unwrap_err();
        assert!(twice.line == 2 && twice.message.contains("in line 1 already"), "{twice}");
    }
}
