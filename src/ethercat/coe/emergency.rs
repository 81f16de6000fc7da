//! Emergencies: mailbox messages that a slave sends on its own when an error occurs or is over.

use crate::ethercat::WireError;
use crate::ethercat::wire_error::split;

/// An emergency message (ETG.1000.6 5.6.4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Emergency {
    /// The error code, as in object 0x603F; 0 means that an error is over.
    pub code: u16,
    /// The error register, as in object 0x1001: bit 0 is set for any error, the other bits for classes of errors (CiA
    /// 301).
    pub register: u8,
    /// Manufacturer-specific error data.
    pub data: [u8; 5],
}

impl Emergency {
    /// Length in bytes of an emergency after the CoE header.
    pub const LEN: usize = 8;

    /// Decodes the body after the CoE header. Bytes after the emergency are ignored.
    ///
    /// # Errors
    /// [`WireError::Short`]: the body has fewer than 8 bytes.
    pub fn decode(body: &[u8]) -> Result<Self, WireError> {
        let ([low, high, register, data @ ..], _) = split::<{ Self::LEN }>(body, "emergency")?;
        Ok(Self { code: u16::from_le_bytes([*low, *high]), register: *register, data: *data })
    }

    /// Encodes the body after the CoE header.
    pub fn encode(&self) -> [u8; Self::LEN] {
        let [low, high] = self.code.to_le_bytes();
        let mut bytes = [low, high, self.register, 0, 0, 0, 0, 0];
        bytes[3..].copy_from_slice(&self.data);
        bytes
    }
}
