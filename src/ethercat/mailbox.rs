//! Mailbox messages: the 6-byte header with its counter, the protocol types, and the error reply to an invalid message.
//!
//! Source: ETG.1000.4 5.6, ETG.1000.6 5.2; rules ECAT-4.

use super::named_codes::named_codes;

use bytemuck::{Pod, Zeroable};

use super::wire_error::{room_for, split};
use super::{U16Le, WireError};

/// Length of the mailbox header in bytes.
pub const MAILBOX_HEADER_LEN: usize = 6;

/// The protocol type of a mailbox message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MailboxProtocol {
    /// 0: the reply to an invalid message; see [`MailboxFault`].
    Error,
    /// 1: ADS over EtherCAT.
    Aoe,
    /// 2: Ethernet over EtherCAT.
    Eoe,
    /// 3: CANopen over EtherCAT.
    Coe,
    /// 4: file access over EtherCAT.
    Foe,
    /// 5: servo profile over EtherCAT.
    Soe,
    /// 15: vendor-specific protocol over EtherCAT.
    Voe,
    /// Any other value, 0..=15.
    Unknown(u8),
}

impl MailboxProtocol {
    /// The protocol with this code on the wire. Only the lower 4 bits of the code are used.
    pub const fn from_code(code: u8) -> Self {
        match code & 0x0F {
            0 => Self::Error,
            1 => Self::Aoe,
            2 => Self::Eoe,
            3 => Self::Coe,
            4 => Self::Foe,
            5 => Self::Soe,
            15 => Self::Voe,
            code => Self::Unknown(code),
        }
    }

    /// The code on the wire, 0..=15.
    pub const fn code(self) -> u8 {
        match self {
            Self::Error => 0,
            Self::Aoe => 1,
            Self::Eoe => 2,
            Self::Coe => 3,
            Self::Foe => 4,
            Self::Soe => 5,
            Self::Voe => 15,
            Self::Unknown(code) => code & 0x0F,
        }
    }
}

/// The message counter in a mailbox header. A slave uses it to detect a repeated message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MailboxCounter(u8);

impl MailboxCounter {
    /// 0: the counter is not used.
    pub const NONE: Self = Self(0);
    /// 1: the first value of the counter.
    pub const FIRST: Self = Self(1);

    /// The counter with that value, 0..=7; `None` above 7.
    pub const fn new(value: u8) -> Option<Self> {
        if value <= 7 { Some(Self(value)) } else { None }
    }

    /// The value, 0..=7.
    pub const fn get(self) -> u8 {
        self.0
    }

    /// The counter of the next message. After 7 follows 1, because 0 means "not used".
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0 % 7 + 1)
    }

    /// Whether a message with this counter repeats the message with the counter `last`. A message with counter 0 never
    /// counts as a repetition, since it does not use the counter.
    pub const fn repeats(self, last: Self) -> bool {
        self.0 != 0 && self.0 == last.0
    }
}

/// Wire layout of the mailbox header. The comments of the fields give byte offsets.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// Bytes 0..=1: length of the data.
    len: U16Le,
    /// Bytes 2..=3: station address.
    address: U16Le,
    /// Byte 4: bits 0..=5 channel, 6..=7 priority.
    channel: u8,
    /// Byte 5: bits 0..=3 protocol, 4..=6 counter.
    protocol: u8,
}

const _: () = assert!(size_of::<Layout>() == MAILBOX_HEADER_LEN && align_of::<Layout>() == 1);

/// A mailbox header, except the length, which follows from the data of the message. Bit 7 of its byte 5 is reserved: it
/// is ignored when decoding and 0 when encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MailboxHeader {
    /// The station address of the partner, if the master only forwards the message: the sender of a message to a slave,
    /// or the receiver of a message from a slave. 0: the master itself is the partner.
    pub address: u16,
    /// The channel, 0..=63. The standard reserves it; it is usually 0.
    pub channel: u8,
    /// The priority, 0..=3.
    pub priority: u8,
    /// The protocol of the data.
    pub protocol: MailboxProtocol,
    /// The message counter.
    pub counter: MailboxCounter,
}

impl MailboxHeader {
    /// The header of a message between a master and a slave: address, channel and priority are 0.
    pub const fn new(protocol: MailboxProtocol, counter: MailboxCounter) -> Self {
        Self { address: 0, channel: 0, priority: 0, protocol, counter }
    }
}

/// A mailbox message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MailboxMessage<'a> {
    /// The header.
    pub header: MailboxHeader,
    /// The data; the header on the wire gives their length.
    pub data: &'a [u8],
}

impl<'a> MailboxMessage<'a> {
    /// Decodes the message at the beginning of a mailbox. Bytes after the message are ignored.
    ///
    /// # Errors
    /// [`WireError::Short`]: the mailbox is shorter than the header, or than the length in the header.
    pub fn decode(mailbox: &'a [u8]) -> Result<Self, WireError> {
        let (header, rest) = split::<MAILBOX_HEADER_LEN>(mailbox, "mailbox header")?;
        let layout: &Layout = bytemuck::cast_ref(header);
        let needed = usize::from(layout.len.get());
        let short = WireError::Short { part: "mailbox message", needed, found: rest.len() };
        let data = rest.get(..needed).ok_or(short)?;
        let header = MailboxHeader {
            address: layout.address.get(),
            channel: layout.channel & 0x3F,
            priority: layout.channel >> 6,
            protocol: MailboxProtocol::from_code(layout.protocol),
            counter: MailboxCounter(layout.protocol >> 4 & 0b111),
        };
        Ok(Self { header, data })
    }

    /// Writes the message at the beginning of a mailbox and fills the rest of the mailbox with 0.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the message does not fit.
    pub fn encode(&self, mailbox: &mut [u8]) -> Result<(), WireError> {
        let place = room_for(mailbox, "mailbox message", MAILBOX_HEADER_LEN + self.data.len())?;
        place[MAILBOX_HEADER_LEN..].copy_from_slice(self.data);
        encode_around(self.header, self.data.len(), mailbox)
    }
}

/// Writes a header into the first 6 bytes of a mailbox, and 0 after the message. The caller has already written the
/// `len` bytes of data after the first 6 bytes.
///
/// # Errors
/// [`WireError::NoRoom`]: the mailbox is shorter than header and data.
pub fn encode_around(header: MailboxHeader, len: usize, mailbox: &mut [u8]) -> Result<(), WireError> {
    let whole = MAILBOX_HEADER_LEN + len;
    room_for(mailbox, "mailbox message", whole)?;
    let layout = Layout {
        len: (len as u16).into(),
        address: header.address.into(),
        channel: header.channel & 0x3F | header.priority << 6,
        protocol: header.protocol.code() | header.counter.get() << 4,
    };
    mailbox[..MAILBOX_HEADER_LEN].copy_from_slice(bytemuck::bytes_of(&layout));
    mailbox[whole..].fill(0);
    Ok(())
}

/// The reason why a mailbox message was invalid: the error code in a reply with the protocol type 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MailboxFault(pub u16);

named_codes! {
    MailboxFault as "mailbox error {}";
    SYNTAX = 1, "syntax of the mailbox header";
    UNSUPPORTED_PROTOCOL = 2, "the protocol is not supported";
    INVALID_CHANNEL = 3, "invalid channel";
    SERVICE_UNSUPPORTED = 4, "the service is not supported";
    INVALID_HEADER = 5, "invalid header of the protocol";
    TOO_SHORT = 6, "the message is too short";
    NO_MORE_MEMORY = 7, "no memory";
    INVALID_SIZE = 8, "invalid size";
    SERVICE_IN_WORK = 9, "the service is in work";
}

impl MailboxFault {
    /// Length in bytes of the data of an error reply.
    pub const LEN: usize = 4;
    /// The type field of the data. The standard defines only 1.
    const TYPE: [u8; 2] = [1, 0];

    /// Encodes the data of a message of type [`MailboxProtocol::Error`].
    pub const fn encode(self) -> [u8; Self::LEN] {
        let [low, high] = self.0.to_le_bytes();
        [Self::TYPE[0], Self::TYPE[1], low, high]
    }

    /// Decodes the data of a message of type [`MailboxProtocol::Error`].
    ///
    /// # Errors
    /// [`WireError::Short`]: fewer than 4 bytes. [`WireError::Field`]: the type is not 1.
    pub fn decode(data: &[u8]) -> Result<Self, WireError> {
        let ([kind @ .., low, high], _) = split::<{ Self::LEN }>(data, "mailbox error")?;
        let kind = u16::from_le_bytes(*kind);
        if kind != 1 {
            return Err(WireError::Field { part: "type of a mailbox error", found: kind.into(), allowed: "1" });
        }
        Ok(Self(u16::from_le_bytes([*low, *high])))
    }
}
