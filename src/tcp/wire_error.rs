//! Errors in received bytes, and the limits of the protocol.

/// The version of the protocol, which must be the same at both ends.
pub const VERSION: u16 = 4;
/// The maximum length of a message's payload in bytes. \[OURS]
pub const PAYLOAD_MAX: usize = 1024;

/// Why received bytes violate the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum WireError {
    /// The first bytes are not the greeting of a server.
    #[error("the program that listens there is no `ecmsk serve tcp`; check host and port")]
    NoServer,
    /// The other end has another version of the protocol.
    #[error("the other end speaks version {found} of the protocol, this one {VERSION}; use the same ecmsk on both")]
    Version { found: u16 },
    /// The payload is longer than [`PAYLOAD_MAX`].
    #[error("a message of {found} bytes, allowed are {PAYLOAD_MAX}")]
    Long { found: usize },
    /// No kind of message has this code.
    #[error("a message of unknown kind 0x{kind:02X}")]
    Kind { kind: u8 },
    /// The message ends in the middle of a field.
    #[error("a message of kind 0x{kind:02X} is short: {needed} bytes needed, {found} left")]
    Short {
        kind: u8,
        /// The length in bytes of the field in which the message ends.
        needed: usize,
        /// How many bytes of the payload are left.
        found: usize,
    },
    /// The message continues after its last field.
    #[error("a message of kind 0x{kind:02X} has {extra} bytes too many")]
    Trailing {
        kind: u8,
        /// The number of extra bytes.
        extra: usize,
    },
    /// A field has a value that is not allowed.
    #[error("a message of kind 0x{kind:02X} has {found} for {field}")]
    Value { kind: u8, field: &'static str, found: u64 },
    /// A text is not UTF-8.
    #[error("a message of kind 0x{kind:02X} has a text that is not UTF-8")]
    Text { kind: u8 },
    /// The message is valid, but not allowed at this point of the exchange.
    #[error("a message of kind 0x{kind:02X} came out of turn")]
    OutOfTurn { kind: u8 },
}
