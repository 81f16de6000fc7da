//! The reasons why a file must not be written to an EEPROM.

use crate::ethercat::WireError;
use crate::ethercat::sii::{SII_INFO_LEN, SiiIdentity};

/// Why the content of a file does not fit an EEPROM.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ContentError {
    /// The length is odd, or shorter than the configuration words at the beginning of an EEPROM.
    #[error(
        "{len} bytes cannot be the content of an EEPROM, which has an even number of at least {} bytes; name a file \
         that `ecmsk bus sii read` or `ecmsk slave sii` has written", SII_INFO_LEN + 2
    )]
    Len { len: usize },
    /// The content is longer than the slave's EEPROM.
    #[error("{len} bytes do not fit into this slave's EEPROM of {room} bytes; name the file that belongs to it")]
    TooLong { len: usize, room: usize },
    /// The checksum of the first seven words, the configuration of the slave controller, is wrong.
    #[error(
        "the checksum of the first 7 words is 0x{found:02X} and should be 0x{expected:02X}: no slave would load them; \
         name an undamaged file"
    )]
    Checksum { found: u8, expected: u8 },
    /// The list of categories after the words with a fixed layout has no end marker, or is damaged.
    #[error("the categories after the first words are not whole ({0}); name a complete file")]
    Categories(WireError),
    /// The content is for another device: vendor or product differ.
    #[error(
        "it is for vendor 0x{:08X}, product 0x{:08X}, and the slave is vendor 0x{:08X}, product 0x{:08X}; name the file that belongs \
         to it, or insist with --other-device", wanted.vendor, wanted.product, found.vendor, found.product
    )]
    OtherDevice { wanted: SiiIdentity, found: SiiIdentity },
}
