//! The value of a manufacturer-specific object: the bytes of an SDO, of any length.

use crate::slave::dictionary::number_of;

/// The maximum length of a value that is stored inline, bytes.
const SHORT: usize = size_of::<u64>();

/// The bytes of a value in SDO order, the lowest first.
#[derive(Clone, Debug)]
pub struct ManufacturerValue(Bytes);

/// The storage of a value. At most 8 bytes are stored inline, so that neither process data nor a short SDO allocates.
#[derive(Clone, Debug)]
enum Bytes {
    Short { len: u8, bytes: [u8; SHORT] },
    Long(Vec<u8>),
}

impl ManufacturerValue {
    /// The low `bytes` bytes of a number, at most 8, as a value.
    pub fn of_bits(bits: u64, bytes: usize) -> Self {
        Self::of_bytes(&bits.to_le_bytes()[..bytes.min(SHORT)])
    }

    /// A value of these bytes.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        let mut value = Self(Bytes::Short { len: 0, bytes: [0; SHORT] });
        value.put(bytes);
        value
    }

    /// The bytes of the value.
    pub fn bytes(&self) -> &[u8] {
        match &self.0 {
            Bytes::Short { len, bytes } => &bytes[..usize::from(*len)],
            Bytes::Long(bytes) => bytes,
        }
    }

    /// The first 8 bytes of the value as a little-endian number; a shorter value is zero-extended.
    pub fn bits(&self) -> u64 {
        match &self.0 {
            Bytes::Short { bytes, .. } => u64::from_le_bytes(*bytes),
            Bytes::Long(bytes) => number_of(bytes),
        }
    }

    /// Replaces the bytes of the value.
    pub(super) fn put(&mut self, new: &[u8]) {
        match &mut self.0 {
            Bytes::Long(bytes) => {
                bytes.clear();
                bytes.extend_from_slice(new);
            }
            Bytes::Short { len, bytes } if new.len() <= SHORT => {
                *bytes = number_of(new).to_le_bytes();
                *len = new.len() as u8;
            }
            short => *short = Bytes::Long(new.to_vec()),
        }
    }
}

impl PartialEq for ManufacturerValue {
    fn eq(&self, other: &Self) -> bool {
        self.bytes() == other.bytes()
    }
}
impl Eq for ManufacturerValue {}
