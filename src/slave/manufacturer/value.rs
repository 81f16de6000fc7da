//! The value of a manufacturer-specific object: the bytes of an SDO, of any length.

use crate::slave::dictionary::number_of;

/// How many bytes a short value has at most.
const SHORT: usize = size_of::<u64>();

/// The bytes of a value as they stand in an SDO, the lowest first.
#[derive(Clone, Debug)]
pub struct ManufacturerValue(Bytes);

/// A short value needs no memory of its own, so that a transfer in a cycle allocates nothing.
#[derive(Clone, Debug)]
enum Bytes {
    Short { len: u8, bytes: [u8; SHORT] },
    Long(Vec<u8>),
}

impl ManufacturerValue {
    /// The low bytes of a number; at most 8.
    pub fn of_bits(bits: u64, bytes: usize) -> Self {
        Self::of_bytes(&bits.to_le_bytes()[..bytes.min(SHORT)])
    }

    /// These bytes.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        let mut value = Self(Bytes::Short { len: 0, bytes: [0; SHORT] });
        value.put(bytes);
        value
    }

    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        match &self.0 {
            Bytes::Short { len, bytes } => &bytes[..usize::from(*len)],
            Bytes::Long(bytes) => bytes,
        }
    }

    /// The number that the first 8 bytes form.
    pub fn bits(&self) -> u64 {
        match &self.0 {
            Bytes::Short { bytes, .. } => u64::from_le_bytes(*bytes),
            Bytes::Long(bytes) => number_of(bytes),
        }
    }

    /// Replaces the value.
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
