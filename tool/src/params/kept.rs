//! Collects the parameters for a backup, and those that it leaves out: objects that the link cannot transfer
//! completely, and objects that the drive does not allow to be read.

use std::fmt;

use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::slave::dictionary::Access;
use ecmsk::slave::{ManufacturerObject, ManufacturerObjects, ManufacturerType, ManufacturerValue};
use serde_json::{Value as Json, json};

use super::ParamsError;
use super::choice::is_parameter;
use super::drive::{Answer, Drive};

/// The number of bytes that a board returns for every object: a shorter value is padded with zeros, a longer one is
/// cut.
pub const BOARD_BYTES: usize = 4;

/// Which values a link can transfer completely, in both directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carries {
    /// Values of at most this many bytes.
    AtMost(usize),
    /// The values that a board transfers: numbers of 1, 2 or 4 bytes. A read returns [`BOARD_BYTES`] bytes of any
    /// object.
    Board,
}

impl Carries {
    /// Why a value of this type and length (in bytes) cannot be transferred completely; `None` if it can. On a board, a
    /// value of unknown type may have any length below 4 bytes, because its length in the drive is not known.
    pub fn obstacle(self, data: ManufacturerType, bytes: usize) -> Option<Why> {
        match self {
            Self::AtMost(most) => (bytes > most).then_some(Why::TooLong { bytes, carries: self }),
            Self::Board if data == ManufacturerType::Text => Some(Why::Text),
            Self::Board if data == ManufacturerType::Any && bytes < BOARD_BYTES => None,
            Self::Board => (!matches!(bytes, 1 | 2 | 4)).then_some(Why::TooLong { bytes, carries: self }),
        }
    }

    /// Whether `present`, the value read from a drive, equals `wanted`, the value in a file. Behind a board, only as
    /// many bytes are compared as the value in the file has. If the file does not know the length, trailing zeros are
    /// ignored.
    pub fn is_same(self, wanted: &ManufacturerObject, present: &[u8]) -> bool {
        let value = wanted.value.bytes();
        match self {
            _ if wanted.data == ManufacturerType::Any => without_zeros(value) == without_zeros(present),
            Self::Board => present.get(..value.len()) == Some(value),
            Self::AtMost(_) => value == present,
        }
    }
}

/// The bytes without the trailing zeros.
fn without_zeros(bytes: &[u8]) -> &[u8] {
    let len = bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    &bytes[..len]
}

/// Why a parameter is left out of a backup, a comparison or a restore.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// The link cannot transfer a value of this length.
    TooLong {
        /// The length of the value, or of the part of it that was read.
        bytes: usize,
        carries: Carries,
    },
    /// The value is a text, and a board does not report the length of a text.
    Text,
    /// The drive does not allow the object to be read.
    NotRead(AbortCode),
    /// The file has entries of a PDO mapping or assignment, but not their number (sub-index 0).
    NoLength,
}

impl Why {
    /// The reason as one word, for JSON.
    pub const fn word(&self) -> &'static str {
        match self {
            Self::TooLong { .. } => "too_long",
            Self::Text => "text",
            Self::NotRead(_) => "not_read",
            Self::NoLength => "no_length",
        }
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLong { carries: Carries::Board, .. } => f.write_str("a board transfers values of 1, 2 or 4 bytes"),
            Self::TooLong { carries: Carries::AtMost(most), .. } => {
                write!(f, "the chip transfers values of up to {most} bytes")
            }
            Self::Text => f.write_str("a board transfers no texts"),
            Self::NotRead(code) => write!(f, "the drive does not let them be read: {code}"),
            Self::NoLength => f.write_str("the file does not have their number of entries, sub-index 0"),
        }
    }
}

/// A parameter that is left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    pub address: ObjectAddress,
    pub name: String,
    pub why: Why,
}

impl LeftOut {
    pub fn of(object: &ManufacturerObject, why: Why) -> Self {
        Self { address: object.address, name: object.name.clone(), why }
    }

    pub fn json(&self) -> Json {
        let ObjectAddress { index, sub } = self.address;
        json!({"index": index, "sub": sub, "name": self.name, "why": self.why.word()})
    }
}

/// Shows the address, and the name if there is one.
impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.address, self.name.trim())
    }
}

/// Groups the parameters by the reason for which they were left out. A reason comes where its first parameter is.
pub fn by_reason(left_out: &[LeftOut]) -> Vec<(Why, Vec<&LeftOut>)> {
    let mut reasons: Vec<(Why, Vec<&LeftOut>)> = Vec::new();
    for one in left_out {
        // Values of different lengths are too long for the same reason, so the texts of the reasons are compared.
        match reasons.iter_mut().find(|(why, _)| why.to_string() == one.why.to_string()) {
            Some((_, of_reason)) => of_reason.push(one),
            None => reasons.push((one.why, vec![one])),
        }
    }
    reasons
}

/// The result of reading the parameters of a drive.
#[derive(Debug, Default)]
pub struct Kept {
    /// The parameters with their values, sorted by address.
    pub objects: Vec<ManufacturerObject>,
    pub left_out: Vec<LeftOut>,
}

impl Kept {
    /// Adds a parameter with the value that the drive has answered, or the reason why it is left out. `carries`: which
    /// values the link can transfer.
    pub fn put(&mut self, object: ManufacturerObject, answer: Answer<Vec<u8>>, carries: Carries) {
        let bytes = match answer {
            Ok(bytes) => bytes,
            Err(code) => return self.left_out.push(LeftOut::of(&object, Why::NotRead(code))),
        };
        let len =
            if carries == Carries::Board { object.data.bytes().map_or(BOARD_BYTES, usize::from) } else { bytes.len() };
        let value = bytes.get(..len).unwrap_or(&bytes);
        match carries.obstacle(object.data, value.len()) {
            Some(why) => self.left_out.push(LeftOut::of(&object, why)),
            None => self.objects.push(ManufacturerObject { value: ManufacturerValue::of_bytes(value), ..object }),
        }
    }
}

/// Reads the parameters that a manufacturer's list of objects names. `at` is called with each index before it is read.
///
/// # Errors
/// The drive does not answer.
pub fn read_listed(
    drive: &mut dyn Drive,
    list: &ManufacturerObjects,
    at: &mut dyn FnMut(u16),
) -> Result<Kept, ParamsError> {
    let carries = drive.carries();
    let mut kept = Kept::default();
    for object in list.objects() {
        if matches!(object.access, Access::ReadOnly | Access::WriteOnly) || !is_parameter(object.address) {
            continue;
        }
        at(object.address.index);
        // Behind a board a read returns only the first bytes of a value, so its length is taken from the list.
        let listed = object.data.bytes().map_or(object.value.bytes().len(), usize::from);
        if carries == Carries::Board
            && let Some(why) = carries.obstacle(object.data, listed)
        {
            kept.left_out.push(LeftOut::of(object, why));
            continue;
        }
        let answer = drive.read(object.address)?;
        kept.put(object.clone(), answer, carries);
    }
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(text: &str) -> ManufacturerObject {
        ManufacturerObjects::parse(text).unwrap().objects()[0].clone()
    }

    /// A board transfers numbers of 1, 2 or 4 bytes, and a chip as many bytes as fit into its packets.
    #[test]
    fn what_a_link_does_not_transfer_is_an_obstacle() {
        let most = Carries::AtMost(20);
        for (data, bytes, board, chip) in [
            (ManufacturerType::U8, 1, None, None),
            (ManufacturerType::U16, 2, None, None),
            (ManufacturerType::F32, 4, None, None),
            (ManufacturerType::U64, 8, Some("too_long"), None),
            (ManufacturerType::Text, 2, Some("text"), None),
            (ManufacturerType::Text, 21, Some("text"), Some("too_long")),
            (ManufacturerType::Any, 3, None, None),
            (ManufacturerType::Any, 5, Some("too_long"), None),
        ] {
            let word = |carries: Carries| carries.obstacle(data, bytes).map(|why| why.word());
            assert_eq!((word(Carries::Board), word(most)), (board, chip), "{data:?} of {bytes}");
        }
    }

    /// Behind a board a read returns 4 bytes. Values of unknown length are compared without their trailing zeros.
    #[test]
    fn values_are_compared_as_far_as_the_link_reads_them() {
        for (wanted, present, board, whole) in [
            ("0x2000:0 u16 rw 2", &[2, 0, 0, 0][..], true, false),
            ("0x2000:0 u16 rw 2", &[2, 0], true, true),
            ("0x2000:0 u16 rw 2", &[2], false, false),
            ("0x2000:0 any rw 2", &[2, 0], true, true),
            ("0x2000:0 any rw 2", &[2, 1, 0, 0], false, false),
            ("0x2000:0 any rw \"\\x02\"", &[2, 1, 0, 0], false, false),
        ] {
            let wanted = object(wanted);
            assert_eq!(Carries::Board.is_same(&wanted, present), board, "{wanted} {present:?}");
            assert_eq!(Carries::AtMost(usize::MAX).is_same(&wanted, present), whole, "{wanted} {present:?}");
        }
    }

    /// Parameters that are left out are grouped by the reason, whatever their lengths.
    #[test]
    fn what_is_left_out_is_ordered_by_reason() {
        let mut kept = Kept::default();
        for (line, answer) in [
            ("0x2000:0 u64 rw 1 Long", Ok(vec![1; 8])),
            ("0x2001:0 u16 rw 1 Kept", Ok(vec![7, 0, 0, 0])),
            ("0x2002:0 u8 rw 1", Err(AbortCode::NO_OBJECT)),
            ("0x2003:0 f64 rw 1 Longer", Ok(vec![1; 8])),
        ] {
            kept.put(object(line), answer, Carries::Board);
        }
        assert_eq!(kept.objects, [object("0x2001:0 u16 rw 7 Kept")]);
        let reasons: Vec<(&str, usize)> =
            by_reason(&kept.left_out).iter().map(|(why, which)| (why.word(), which.len())).collect();
        assert_eq!(reasons, [("too_long", 2), ("not_read", 1)]);
        assert_eq!(kept.left_out[0].to_string(), "0x2000:0 Long");
    }
}
