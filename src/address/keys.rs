//! The keys of a link's URI. One table, `keys/table.rs`, defines them for the parser, the defaults and the help
//! (`ecmsk link help`). A new key is a row of the table and a field of the options that use it: CONTRIBUTING.md lists the
//! files of these options.

mod table;

use std::time::Duration;

use super::fraction::Fraction;
pub use super::scheme::Scheme;
use super::slaves;
use super::text::decimal;
pub use table::KEYS;

/// The end of every error message about an invalid link URI, which tells the user where the keys are described.
pub(crate) const WHERE_TO_LOOK: &str = "see `ecmsk link help`";

/// The syntax of a key's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Syntax {
    /// One of these words.
    Choice(&'static [&'static str]),
    /// A decimal integer in this range, both ends included.
    Number(u64, u64),
    /// A decimal number in this range, both ends included, with at most 9 digits after the point.
    Fraction(Fraction, Fraction),
    /// The path of a file.
    File,
    /// The path of a folder.
    Folder,
    /// 1 to 64 letters, digits, `-`, `_` and `.`.
    Name,
    /// A USB string descriptor: 1 to 126 characters.
    Text,
    /// A USB vendor or product ID: 1 to 4 hexadecimal digits, optionally after `0x`.
    UsbId,
    /// A frequency in Hz in this range, both ends included: an integer, optionally followed by `k` or `M`.
    Hertz(u64, u64),
    /// A number of bytes in this range, both ends included: an integer, optionally followed by `k`, `M` or `G` for 10^3,
    /// 10^6 or 10^9.
    Bytes(u64, u64),
    /// A GPIO line: `CHIP/LINE`, a chip such as `gpiochip0` and the number or the name of its line.
    Line,
    /// A list of simulated slaves, see [`slaves`].
    Slaves,
    /// 1 to 6 GPIO pin numbers of an ECM-XF, separated by commas: element k is the pin that line k of the board's local
    /// inputs or outputs is wired to, from 0 to this number; `-` for a line that is not wired. No pin may appear twice.
    Pins(u8),
}

/// The longest text of a USB string descriptor, in characters (USB 2.0 9.6.7).
const TEXT_MAX: usize = 126;

/// The longest name of a board, in characters. \[OURS]
const NAME_MAX: usize = 64;

impl Syntax {
    /// Checks a value and converts it to its normal form. Values with the same meaning have the same normal form.
    ///
    /// # Errors
    /// Why the value is invalid, and what is allowed.
    pub fn normal(self, value: &str) -> Result<String, String> {
        let normal = match self {
            Self::Choice(words) => words.contains(&value).then(|| value.to_owned()),
            Self::Number(min, max) => {
                decimal(value).filter(|number| (min..=max).contains(number)).map(|number| number.to_string())
            }
            Self::Fraction(min, max) => {
                let number = Fraction::parse(value).filter(|number| (min..=max).contains(number));
                number.map(|number| number.to_string())
            }
            Self::File | Self::Folder => (!value.is_empty() && !value.contains('\0')).then(|| value.to_owned()),
            Self::Name => {
                let plain = value.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b));
                (plain && (1..=NAME_MAX).contains(&value.len())).then(|| value.to_owned())
            }
            Self::Text => (1..=TEXT_MAX).contains(&value.chars().count()).then(|| value.to_owned()),
            Self::UsbId => usb_id(value).map(|id| format!("{id:04x}")),
            Self::Hertz(min, max) => hertz(value).filter(|number| (min..=max).contains(number)).map(hertz_text),
            Self::Bytes(min, max) => {
                byte_count(value).filter(|number| (min..=max).contains(number)).map(byte_count_text)
            }
            Self::Line => value
                .rsplit_once('/')
                .is_some_and(|(chip, line)| !chip.is_empty() && !chip.ends_with('/') && !line.is_empty())
                .then(|| value.to_owned())
                .filter(|value| !value.contains('\0')),
            Self::Slaves => return Ok(slaves::normal(&slaves::parse(value)?)),
            // Lines that the list does not reach are not wired, so `,-` at its end is left out.
            Self::Pins(max) => pins(value, max).map(|_| value.trim_end_matches(",-").to_owned()),
        };
        normal.ok_or_else(|| self.allowed())
    }

    /// The allowed values as text for an error message, after `allowed: `.
    pub fn allowed(self) -> String {
        match self {
            Self::Choice(words) => format!("allowed: {}", words.join(", ")),
            Self::Number(min, max) => format!("allowed: a whole number from {min} to {max}"),
            Self::Fraction(min, max) => {
                format!("allowed: a number from {min} to {max}, at most 9 digits after the point")
            }
            Self::File => "allowed: the path of a file".to_owned(),
            Self::Folder => "allowed: the path of a folder".to_owned(),
            Self::Name => format!("allowed: 1 to {NAME_MAX} letters, digits, `-`, `_` and `.`"),
            Self::Text => format!("allowed: 1 to {TEXT_MAX} characters"),
            Self::UsbId => "allowed: 1 to 4 hexadecimal digits, e.g. 16c0".to_owned(),
            Self::Hertz(min, max) => {
                format!("allowed: a frequency from {} to {} Hz, e.g. 500k or 24M", hertz_text(min), hertz_text(max))
            }
            Self::Bytes(min, max) => format!(
                "allowed: a number of bytes from {} to {}, e.g. 500M or 4G",
                byte_count_text(min),
                byte_count_text(max)
            ),
            Self::Line => {
                "allowed: CHIP/LINE, a GPIO chip and the number or name of its line, e.g. gpiochip0/25".to_owned()
            }
            Self::Slaves => format!("allowed: {}", slaves::form()),
            Self::Pins(max) => format!(
                "allowed: 1 to 6 GPIO numbers from 0 to {max}, or - for a line that is not wired, each number once, e.g. 0,1,-,3"
            ),
        }
    }

    /// The text that stands for the value in the help, such as `FILE` or `0..1`.
    pub(crate) fn placeholder(self) -> String {
        match self {
            Self::Choice(words) => words.join("|"),
            Self::Number(min, max) => format!("{min}..{max}"),
            Self::Fraction(min, max) => format!("{min}..{max}"),
            Self::File => "FILE".to_owned(),
            Self::Folder => "DIR".to_owned(),
            Self::Name => "NAME".to_owned(),
            Self::Text => "TEXT".to_owned(),
            Self::UsbId => "HEX".to_owned(),
            Self::Hertz(min, max) => format!("{}..{}", hertz_text(min), hertz_text(max)),
            Self::Bytes(min, max) => format!("{}..{}", byte_count_text(min), byte_count_text(max)),
            Self::Line => "CHIP/LINE".to_owned(),
            Self::Slaves => "LIST".to_owned(),
            Self::Pins(_) => "GPIO,GPIO,..".to_owned(),
        }
    }
}

/// Parses a list of pins as links write it: element k is the pin of line k, `None` if the line is not wired.
pub(crate) fn pins(value: &str, max: u8) -> Option<[Option<u8>; 6]> {
    let mut pins = [None; 6];
    for (place, pin) in value.split(',').enumerate() {
        let number = match pin {
            "-" => None,
            digits => Some(decimal(digits).filter(|number| *number <= max.into())? as u8),
        };
        if number.is_some() && pins.contains(&number) {
            return None;
        }
        *pins.get_mut(place)? = number;
    }
    Some(pins)
}

/// Parses a frequency as links write it, such as `24M` or `500k`, and returns it in Hz.
pub(crate) fn hertz(value: &str) -> Option<u64> {
    let (digits, unit) = match value.strip_suffix('M') {
        Some(digits) => (digits, 1_000_000),
        None => value.strip_suffix('k').map_or((value, 1), |digits| (digits, 1000)),
    };
    decimal(digits)?.checked_mul(unit)
}

/// The units of a number of bytes.
const BYTE_UNITS: [(char, u64); 3] = [('G', 1_000_000_000), ('M', 1_000_000), ('k', 1000)];

/// Parses a number of bytes as links and the tool write it, such as `500M` or `4G`.
pub fn byte_count(value: &str) -> Option<u64> {
    let unit = BYTE_UNITS.into_iter().find_map(|(unit, factor)| Some((value.strip_suffix(unit)?, factor)));
    let (digits, factor) = unit.unwrap_or((value, 1));
    decimal(digits)?.checked_mul(factor)
}

/// The shortest text for a number of bytes: `4G`, `500M`, else all digits.
fn byte_count_text(number: u64) -> String {
    let unit = BYTE_UNITS.into_iter().find(|(_, factor)| number > 0 && number.is_multiple_of(*factor));
    unit.map_or_else(|| number.to_string(), |(unit, factor)| format!("{}{unit}", number / factor))
}

/// Parses a time in milliseconds.
pub(crate) fn millis(value: &str) -> Option<Duration> {
    value.parse().ok().map(Duration::from_millis)
}

/// Parses a USB vendor or product ID.
pub(crate) fn usb_id(value: &str) -> Option<u16> {
    let digits = value.strip_prefix("0x").unwrap_or(value);
    u16::from_str_radix(digits, 16).ok().filter(|_| digits.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

/// The shortest text for a frequency in Hz: `24M` for whole MHz, `500k` for whole kHz, else all digits.
fn hertz_text(number: u64) -> String {
    match number {
        0 => "0".to_owned(),
        _ if number.is_multiple_of(1_000_000) => format!("{}M", number / 1_000_000),
        _ if number.is_multiple_of(1000) => format!("{}k", number / 1000),
        _ => number.to_string(),
    }
}

/// One key of a link's URI.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    /// The name of the key.
    pub name: &'static str,
    /// The schemes whose links have the key.
    pub schemes: &'static [Scheme],
    /// The syntax of the value.
    pub syntax: Syntax,
    /// The value in normal form that applies if the URI does not have the key. `None`: there is no default, and
    /// `meaning` says what happens then.
    pub default: Option<&'static str>,
    /// A valid value other than the default, for examples and tests: it has to appear in a URI's normal form.
    pub example: &'static str,
    /// The effect of the key, with the unit of its value.
    pub meaning: &'static str,
}

impl Key {
    /// Looks up the key `name` in the table; `None` if links of the scheme do not have this key.
    pub fn find(scheme: Scheme, name: &str) -> Option<&'static Self> {
        Self::of(scheme).find(|key| key.name == name)
    }

    /// The keys that links of `scheme` have, in the order of the table.
    pub fn of(scheme: Scheme) -> impl Iterator<Item = &'static Self> {
        KEYS.iter().filter(move |key| key.schemes.contains(&scheme))
    }
}
