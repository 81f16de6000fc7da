//! The object dictionary of a slave as the slave describes it by the SDO information service, with the values.

use std::fmt;

use super::{BusError, Network};
use crate::ethercat::coe::{
    AbortCode, DataTypeCode, EntryDescription, EntryRequest, ObjectAccess, ObjectAddress, ObjectCode,
    ObjectDescription, SdoScope, ValueForm, ValueInfo,
};
use crate::master::SdoError;

/// An object of the dictionary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Object {
    /// The index of the object.
    pub index: u16,
    /// The name of the object, decoded from UTF-8 or ISO-8859-1.
    pub name: String,
    /// The object code: a variable, an array or a record.
    pub code: ObjectCode,
    /// The data type of the object's values.
    pub data_type: DataTypeCode,
    /// The highest sub-index.
    pub max_sub: u8,
}

/// One sub-index of an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Index and sub-index of the entry.
    pub object: ObjectAddress,
    /// The name of the entry, decoded from UTF-8 or ISO-8859-1.
    pub name: String,
    /// The data type of the value.
    pub data_type: DataTypeCode,
    /// The length of the value, bits.
    pub bits: u16,
    /// In which AL states the entry can be read, written or mapped.
    pub access: ObjectAccess,
}

/// The objects of a slave, by ascending index. Objects that the slave does not describe are left out.
///
/// # Errors
/// [`BusError::NoCoe`], [`BusError::NoInformation`]: the slave has no CoE, or no SDO information service.
/// [`BusError::Information`]: it gives no valid answer.
pub fn objects(network: &mut dyn Network, slave: u8) -> Result<Vec<Object>, BusError> {
    let mut indices = network.object_list(slave)?;
    indices.sort_unstable();
    indices.dedup();
    let mut objects = Vec::with_capacity(indices.len());
    for index in indices {
        let bytes = match network.describe_object(slave, index) {
            Err(BusError::Information { error: SdoError::Abort(_), .. }) => continue,
            described => described?,
        };
        let Ok(ObjectDescription { data_type, max_sub, code, name, .. }) = ObjectDescription::decode(&bytes) else {
            continue;
        };
        let name = text(name);
        objects.push(Object { index, name, code, data_type: DataTypeCode(data_type), max_sub });
    }
    Ok(objects)
}

/// The entries of an object. Sub-indices that the slave does not describe are left out.
///
/// # Errors
/// The errors of [`objects`].
pub fn entries(network: &mut dyn Network, slave: u8, object: &Object) -> Result<Vec<Entry>, BusError> {
    let mut entries = Vec::new();
    for sub in 0..=object.max_sub {
        let object = ObjectAddress::new(object.index, sub);
        let bytes = match network.describe_entry(slave, EntryRequest { object, wanted: ValueInfo::ACCESS }) {
            Err(BusError::Information { error: SdoError::Abort(_), .. }) => continue,
            described => described?,
        };
        let Ok(described) = EntryDescription::decode(&bytes) else { continue };
        entries.push(Entry {
            object,
            // The request asks for the access rights and no other values, so the data after the fixed fields are the name
            // of the entry.
            name: text(described.data),
            data_type: DataTypeCode(described.data_type),
            bits: described.bits,
            access: described.access,
        });
    }
    Ok(entries)
}

/// Reads the value of an entry. `None`: the entry is not readable. `Some(Err(code))`: the slave has refused the read with
/// this abort code.
///
/// # Errors
/// [`BusError::Sdo`]: the slave does not answer, or its answer is invalid.
pub fn value(
    network: &mut dyn Network,
    slave: u8,
    entry: &Entry,
) -> Result<Option<Result<Vec<u8>, AbortCode>>, BusError> {
    if !entry.access.intersects(ObjectAccess::READ) {
        return Ok(None);
    }
    match network.upload(slave, entry.object, SdoScope::Entry) {
        Err(BusError::Sdo { error: SdoError::Abort(code), .. }) => Ok(Some(Err(code))),
        value => value.map(|bytes| Some(Ok(bytes))),
    }
}

/// Decodes a text: as UTF-8 if it is valid, otherwise as ISO-8859-1, which some slaves use.
fn text(bytes: &[u8]) -> String {
    let latin = || bytes.iter().map(|byte| char::from(*byte)).collect();
    let text = str::from_utf8(bytes).map_or_else(|_| latin(), str::to_owned);
    text.trim_end_matches('\0').to_owned()
}

/// A value, decoded by its data type.
#[derive(Clone, Debug, PartialEq)]
pub enum ObjectValue {
    /// An integer of at most 64 bits.
    Whole(i128),
    /// A floating-point number.
    Real(f64),
    /// A text.
    Text(String),
    /// Bytes without a known meaning.
    Bytes(Vec<u8>),
}

impl ObjectValue {
    /// Decodes bytes by a data type. Bytes that do not fit the type become [`ObjectValue::Bytes`].
    pub fn of(data_type: DataTypeCode, bytes: &[u8]) -> Self {
        let unsigned = || bytes.iter().rev().fold(0u64, |number, byte| number << 8 | u64::from(*byte));
        match (data_type.form(), bytes.len()) {
            (ValueForm::Unsigned, 1..=8) => Self::Whole(unsigned().into()),
            (ValueForm::Signed, len @ 1..=8) => {
                let left = 64 - 8 * len as u32;
                Self::Whole(((unsigned() << left).cast_signed() >> left).into())
            }
            (ValueForm::Real, 4) => Self::Real(f32::from_bits(unsigned() as u32).into()),
            (ValueForm::Real, 8) => Self::Real(f64::from_bits(unsigned())),
            (ValueForm::Text, _) => Self::Text(text(bytes)),
            _ => Self::Bytes(bytes.to_vec()),
        }
    }
}

impl fmt::Display for ObjectValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole(number) => number.fmt(f),
            Self::Real(number) => number.fmt(f),
            Self::Text(text) => write!(f, "\"{text}\""),
            Self::Bytes(bytes) if bytes.is_empty() => f.write_str("(nothing)"),
            Self::Bytes(bytes) => {
                let digits: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
                f.write_str(&digits.join(" "))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// BUS-3.2 Values are decoded by their data types; bytes that do not fit a type stay bytes.
    #[test]
    fn values_are_read_by_their_types() {
        for (data_type, bytes, shown) in [
            (DataTypeCode::UNSIGNED8, &[0xFF][..], "255"),
            (DataTypeCode::INTEGER8, &[0xFF], "-1"),
            (DataTypeCode::INTEGER16, &[0x00, 0x80], "-32768"),
            (DataTypeCode::INTEGER24, &[0xFF, 0xFF, 0xFF], "-1"),
            (DataTypeCode::UNSIGNED24, &[1, 2, 3], "197121"),
            (DataTypeCode::UNSIGNED64, &[0xFF; 8], "18446744073709551615"),
            (DataTypeCode::INTEGER64, &[0xFF; 8], "-1"),
            (DataTypeCode::REAL32, &[0, 0, 0xC0, 0x3F], "1.5"),
            (DataTypeCode::REAL64, &[0, 0, 0, 0, 0, 0, 0xF8, 0xBF], "-1.5"),
            (DataTypeCode::VISIBLE_STRING, b"drive\0\0", "\"drive\""),
            (DataTypeCode::BIT3, &[5], "5"),
            (DataTypeCode::OCTET_STRING, &[1, 0xAB], "01 AB"),
            (DataTypeCode(0x1234), &[1], "01"),
            (DataTypeCode::UNSIGNED32, &[0; 9], "00 00 00 00 00 00 00 00 00"),
            (DataTypeCode::REAL32, &[], "(nothing)"),
        ] {
            assert_eq!(ObjectValue::of(data_type, bytes).to_string(), shown, "{data_type}");
        }
    }
}
