//! The text format of manufacturer-specific objects: one object a line, `INDEX:SUB TYPE ACCESS VALUE NAME`.

use super::{ManufacturerObject, ManufacturerObjects, ManufacturerType};
use crate::coe::ObjectAddress;
use crate::slave::dictionary::Access;

/// The size of the largest file of objects, bytes \[OURS]: some 50,000 lines.
pub const MANUFACTURER_FILE_BYTES_MAX: u64 = 4 << 20;

/// What a line looks like, for errors.
const FORM: &str = "a line is INDEX:SUB TYPE ACCESS VALUE NAME, e.g. `0x2101:1 u16 rw 0x0010 Motor code`";

/// Why a text is no list of objects.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {message}; {FORM}")]
pub struct FormatError {
    /// The line, from 1.
    pub line: usize,
    /// What is wrong and what is allowed.
    pub message: String,
}

impl ManufacturerObjects {
    /// Reads a text of objects, one a line: `INDEX:SUB TYPE ACCESS VALUE NAME`.
    ///
    /// - `INDEX:SUB`: hexadecimal with 0x, or decimal: `0x2101:1`.
    /// - `TYPE`: `bool`, `i8`, `u8`, `i16`, `u16`, `i32`, `u32`, `f32`, `i64`, `u64`, `f64`, `text`, or `any` for a value
    ///   of unknown size.
    /// - `ACCESS`: `ro`, `rw` or `wo`.
    /// - `VALUE`: a number; with 0x the bytes as they stand in an SDO. `-`: 0.
    /// - `NAME`: the rest of the line, for people; may be left out.
    ///
    /// `#` at the beginning of a line begins a remark. A line may stand for an address once.
    ///
    /// # Errors
    /// [`FormatError`], with the line.
    pub fn parse(text: &str) -> Result<Self, FormatError> {
        let mut objects = Vec::new();
        let mut lines = std::collections::HashMap::new();
        // Editors on Windows put a byte order mark in front.
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
    let (value, name) = word(rest);
    let bits = bits(data, value).ok_or_else(|| {
        let bytes = data.bytes().map_or("8 bytes at most".to_owned(), |bytes| format!("{bytes} bytes"));
        format!("`{value}` is no VALUE of type {}; allowed: a number of {bytes}, with 0x its bytes, or -", data.word())
    })?;
    Ok(ManufacturerObject { address: ObjectAddress::new(index, sub), data, access, bits, name: name.to_owned() })
}

/// The first word of a line, and the rest of the line.
fn word(text: &str) -> (&str, &str) {
    let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, rest.trim_start())
}

/// A whole number, with 0x hexadecimal.
fn whole(text: &str) -> Option<u64> {
    let (digits, radix) = text.strip_prefix("0x").or(text.strip_prefix("0X")).map_or((text, 10), |hex| (hex, 16));
    // `from_str_radix` alone would let a plus sign pass.
    let plain = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    u64::from_str_radix(digits, radix).ok().filter(|_| plain)
}

/// The value as the bytes of an SDO; `None`: the text is no value of that data type.
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

    /// SK-7.46 What a line may say, and that it is written as it is read.
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
        ] {
            let read = object(line.trim()).unwrap_or_else(|why| panic!("{line}: {why}"));
            assert_eq!((read.bits, read.to_string().as_str()), (bits, written), "{line}");
            assert_eq!(object(written).as_ref(), Ok(&read), "{line}");
        }
    }

    /// SK-7.46 What is wrong is said with the line and with what is allowed.
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
        ] {
            let error = ManufacturerObjects::parse(&format!("# remark\n\n{line}\n")).unwrap_err();
            assert!(error.line == 3 && error.message.contains(words), "{line}: {error}");
            assert!(error.to_string().starts_with("line 3: ") && error.to_string().contains("e.g. `0x2101:1"));
        }
        let twice = ManufacturerObjects::parse("0x2000:0 u8 rw 1\r\n0x2000:0 u8 rw 2\r\n").unwrap_err();
        assert!(twice.line == 2 && twice.message.contains("in line 1 already"), "{twice}");
    }
}
