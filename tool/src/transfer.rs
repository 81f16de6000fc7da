//! The arguments of an SDO read or write in `ecmsk bus` and `ecmsk xf`, and the text of the value.

use ecmsk::coe::SdoScope;
use serde_json::{Value as Json, json};

use crate::hex::{hex, parse_hex, spaced};
use crate::step::object::{Object, Type, Value};

/// The object that a verb reads or writes by SDO, and the form of its value.
#[derive(Clone, clap::Args)]
#[group(skip)]
pub struct Transfer {
    /// The object: 0x6064, 0x6099:1, or a name: statusword, position_actual, homing_method ..
    #[arg(value_name = "OBJECT[:SUB]", value_parser = Object::parse)]
    pub object: Object,
    /// The type of the value: u8, i8, u16, i16, u32 or i32 [default: the object's type, where it is known]
    #[arg(long = "type", value_name = "TYPE", value_parser = Type::parse)]
    pub of: Option<Type>,
    /// All sub-indices of the object at once, as bytes (complete access, which not every drive has)
    #[arg(long, conflicts_with = "of")]
    pub complete: bool,
}

/// The value that an SDO write sends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Written {
    Number(Value),
    Bytes(Vec<u8>),
}

impl Written {
    /// Parses a number, or bytes after the prefix `hex:`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        match text.strip_prefix("hex:") {
            Some(bytes) => parse_hex(bytes).map(Self::Bytes),
            None => {
                Value::parse(text).map(Self::Number).map_err(|allowed| format!("{allowed}, or bytes as hex:0102FF"))
            }
        }
    }
}

/// Why a value cannot be written.
#[derive(Debug, PartialEq, Eq)]
pub struct WrongValue {
    /// What is wrong with the value.
    pub why: String,
    /// What the user can do next.
    pub next: String,
}

/// The number of bytes read is not that of the type.
#[derive(Debug, PartialEq, Eq)]
pub struct SizeMismatch {
    /// The number of bytes read.
    pub found: usize,
    /// The number of bytes of the type.
    pub wanted: usize,
}

impl Transfer {
    fn of(&self) -> Option<Type> {
        if self.complete { None } else { self.of.or(self.object.known.map(|(_, of)| of)) }
    }

    /// Whether the transfer is of one sub-index or of all of them (complete access).
    pub const fn scope(&self) -> SdoScope {
        if self.complete { SdoScope::Complete } else { SdoScope::Entry }
    }

    fn json(&self, verb: &str, slave: u8, bytes: &[u8]) -> Json {
        json!({
            "verb": verb, "slave": slave, "index": self.object.address.index, "sub": self.object.address.sub,
            "complete": self.complete, "bytes": hex(bytes),
        })
    }

    /// The value read, as text and as JSON.
    ///
    /// # Errors
    /// [`SizeMismatch`] if `bytes` does not have the length of the object's type.
    pub fn read(&self, verb: &str, slave: u8, bytes: &[u8]) -> Result<(String, Json), SizeMismatch> {
        let mut json = self.json(verb, slave, bytes);
        let Some(of) = self.of() else { return Ok((self.untyped(bytes), json)) };
        let wanted = of.bits() as usize / 8;
        if bytes.len() != wanted {
            return Err(SizeMismatch { found: bytes.len(), wanted });
        }
        let raw = number(bytes);
        let value = of.number(raw);
        json["type"] = of.name().into();
        json["value"] = value.into();
        let digits = 2 * wanted;
        Ok((format!("{value} (0x{raw:0digits$X})"), json))
    }

    /// The value of an object of unknown type as text: its bytes, and where possible also a number or a text.
    fn untyped(&self, bytes: &[u8]) -> String {
        if self.complete {
            return spaced(bytes);
        }
        let object = self.object;
        match bytes.len() {
            1..=4 => format!("0x{0:X} ({0}); the type of {object} is not known", number(bytes)),
            _ => match std::str::from_utf8(bytes) {
                Ok(text) if !bytes.is_empty() && bytes.iter().all(|byte| (b' '..=b'~').contains(byte)) => {
                    format!("{}, as a text `{text}`", spaced(bytes))
                }
                _ => spaced(bytes),
            },
        }
    }

    /// The confirmation of a write, as text and as JSON.
    pub fn written(&self, verb: &str, slave: u8, value: &Written, bytes: &[u8]) -> (String, Json) {
        let mut json = self.json(verb, slave, bytes);
        let text = match (value, self.of()) {
            (Written::Number(_), Some(of)) => {
                let value = of.number(number(bytes));
                json["type"] = of.name().into();
                json["value"] = value.into();
                value.to_string()
            }
            _ => spaced(bytes),
        };
        (format!("slave {slave}: {} = {text}", self.object), json)
    }

    /// Encodes the value to the bytes to write. `verb` is the verb whose help the error names.
    ///
    /// # Errors
    /// [`WrongValue`] if a number is written to an object of unknown type, does not fit the type, or is written with
    /// complete access.
    pub fn encoded(&self, verb: &str, value: &Written) -> Result<Vec<u8>, WrongValue> {
        let value = match value {
            Written::Bytes(bytes) => return Ok(bytes.clone()),
            Written::Number(value) => *value,
        };
        let wrong = |why, next: &str| WrongValue { why, next: format!("{next}, see `ecmsk {verb} --help`") };
        match self.of() {
            _ if self.complete => Err(wrong("all sub-indices at once are bytes".into(), "write them as hex:0102FF")),
            None => {
                Err(wrong(format!("the type of {} is not known", self.object), "name it with --type, e.g. --type u16"))
            }
            Some(of) if !of.takes(value) => Err(wrong(
                format!("{} has the type {}, {} does not fit", self.object, of.name(), value.number),
                "correct the value, or --type",
            )),
            Some(of) => Ok(value.number.to_le_bytes()[..of.bits() as usize / 8].to_vec()),
        }
    }
}

/// Up to 4 bytes as a number, lowest byte first.
fn number(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}
