//! Mailboxes of slaves, and the emergencies that came through them.

use super::{Arguments, Call, SlaveNumber, short};
use crate::xf::response::Emergencies;
use crate::xf::value::choices;
use crate::xf::{CommandCode, Malformed, segment};

/// The most emergencies that the chip lists.
pub const EMERGENCIES_MAX: usize = 8;

short! {
    /// COE_EMERGENCY, code 83: the newest emergencies. `par` how many (XF EN 1490).
    CoeEmergency {
        /// How many.
        pub count: EmergencyCount,
    }, CoeEmergency -> Emergencies,
        |request| Arguments::NONE.parameter(request.count.get()),
        |a| Self {
            count: EmergencyCount::new(a.parameter)
                .ok_or(Malformed::only("COE_EMERGENCY count", a.parameter.into(), "1 to 8"))?,
        };
}

/// How many emergencies are asked for, 1..=8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EmergencyCount(u8);

impl EmergencyCount {
    /// So many; `None` unless `n` is 1..=8.
    pub const fn new(n: u8) -> Option<Self> {
        if n >= 1 && n as usize <= EMERGENCIES_MAX { Some(Self(n)) } else { None }
    }

    /// How many.
    pub const fn get(self) -> u8 {
        self.0
    }
}

choices! {
    /// `par` of [`ReceiveMailbox`].
    pub(in crate::xf) ReceiveMailboxOperation(u8), "RECV_MAILBOX operation", "0 request, 1 read" {
        /// 0: the chip fetches the mailbox.
        Request = 0,
        /// 1: a part of what it fetched is given.
        Read = 1,
    }

    /// `par` of [`MailboxStatus`].
    pub(in crate::xf) MailboxStatusOperation(u8), "MBX_STAT operation", "0 read flags, 1 set polling, 2 read polling" {
        /// 0: which mailboxes are full.
        ReadFlags = 0,
        /// 1: which mailboxes are polled, is set.
        SetPolling = 1,
        /// 2: which mailboxes are polled, is read.
        ReadPolling = 2,
    }
}

/// A part of a mailbox.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MailboxPart {
    start: u16,
    length: u16,
}

impl MailboxPart {
    /// From byte `start`, 0..=63, so many bytes, 0..=63; `None` for others.
    ///
    /// Above these the manuals can be read in two ways, as 64 or as 256 times the high byte, so that a host does not
    /// ask for them.
    pub const fn new(start: u8, length: u8) -> Option<Self> {
        if start < 64 && length < 64 { Some(Self { start: start as u16, length: length as u16 }) } else { None }
    }

    /// The first byte.
    pub const fn start(self) -> u16 {
        self.start
    }

    /// How many bytes.
    pub const fn length(self) -> u16 {
        self.length
    }

    /// Two information bytes as a number, up to 16575. `[OURS]` As the manuals' text has it, high * 64 + low; their
    /// drawing shows a field of 16 bits, where the high byte would count 256.
    const fn number(low: u8, high: u8) -> u16 {
        high as u16 * 64 + low as u16
    }

    /// The other way round. A number that [`Self::number`] gave fits.
    const fn bytes(number: u16) -> [u8; 2] {
        // The largest, 255 * 64 + 255, has no low part below 64.
        let high = if number / 64 > 255 { 255 } else { number / 64 };
        [(number - high * 64) as u8, high as u8]
    }
}

/// RECV_MAILBOX, code 143: what a slave sent by mailbox (XF EN 1646, XF ZH 1563). The answer to the second form has the
/// bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReceiveMailbox {
    /// `par` 0: the chip fetches a slave's mailbox. `i0`, `i1` u16 slave.
    Request {
        /// Which slave.
        slave: SlaveNumber,
    },
    /// `par` 1: a part of what it fetched. `i0`, `i1` start, `i2`, `i3` length.
    Read(MailboxPart),
}

impl ReceiveMailbox {
    pub(super) const fn parameter(&self) -> u8 {
        match self {
            Self::Request { .. } => ReceiveMailboxOperation::Request.code(),
            Self::Read(_) => ReceiveMailboxOperation::Read.code(),
        }
    }
}

impl Call<'_> for ReceiveMailbox {
    const CODE: CommandCode = CommandCode::ReceiveMailbox;
    type Answer<'a> = &'a [u8];

    fn encode(&self, _: &mut [u8]) -> Result<Arguments, Malformed> {
        let info = match *self {
            Self::Request { slave } => [slave.get(), 0, 0, 0],
            Self::Read(MailboxPart { start, length }) => {
                let ([i0, i1], [i2, i3]) = (MailboxPart::bytes(start), MailboxPart::bytes(length));
                [i0, i1, i2, i3]
            }
        };
        Ok(Arguments::NONE.parameter(self.parameter()).info(info))
    }

    fn decode(arguments: &Arguments, _: &[u8]) -> Result<Self, Malformed> {
        let [i0, i1, i2, i3] = arguments.info;
        Ok(match ReceiveMailboxOperation::decode(arguments.parameter)? {
            ReceiveMailboxOperation::Request => {
                Self::Request { slave: SlaveNumber::decode_wide(u16::from_le_bytes([i0, i1]))? }
            }
            ReceiveMailboxOperation::Read => {
                Self::Read(MailboxPart { start: MailboxPart::number(i0, i1), length: MailboxPart::number(i2, i3) })
            }
        })
    }
}

/// A bit for each slave: bit b of byte k is slave 8 k + b.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SlaveBits {
    bits: u128,
    bytes: u8,
}

impl SlaveBits {
    /// The bytes of a set for 128 slaves.
    const BYTES: usize = 16;

    /// No slave of a network of so many, 0..=128; more count as 128.
    pub const fn for_slaves(slaves: u8) -> Self {
        let bytes = slaves.div_ceil(8);
        Self { bits: 0, bytes: if bytes as usize > Self::BYTES { Self::BYTES as u8 } else { bytes } }
    }

    /// The same set with that slave in it, and with as many bytes as it needs for that.
    #[must_use]
    pub const fn with(self, slave: SlaveNumber) -> Self {
        let needed = slave.get() / 8 + 1;
        let bytes = if self.bytes < needed { needed } else { self.bytes };
        Self { bits: self.bits | 1 << slave.get(), bytes }
    }

    /// Whether the slave is in the set.
    pub const fn contains(self, slave: SlaveNumber) -> bool {
        self.bits & 1 << slave.get() != 0
    }

    /// How many bytes the length field counts: 1 for 8 slaves.
    pub const fn bytes(self) -> u8 {
        self.bytes
    }

    /// Writes all 16 bytes and returns how many the length field counts.
    pub(in crate::xf) fn write(self, data: &mut [u8]) -> Result<u16, Malformed> {
        segment::put(data, &self.bits.to_le_bytes())?;
        Ok(self.bytes.into())
    }

    /// Reads all 16 bytes, whatever the length field counts.
    pub(in crate::xf) fn read(data: &[u8], len: u16) -> Result<Self, Malformed> {
        let bits = u128::from_le_bytes(segment::get(data)?);
        Ok(Self { bits, bytes: len.min(Self::BYTES as u16) as u8 })
    }

    /// Reads the bytes that an answer has, those for the first 128 slaves.
    pub(in crate::xf) fn read_valid(valid: &[u8]) -> Self {
        let (mut bytes, len) = ([0; Self::BYTES], valid.len().min(Self::BYTES));
        bytes[..len].copy_from_slice(&valid[..len]);
        Self { bits: u128::from_le_bytes(bytes), bytes: len as u8 }
    }
}

/// MBX_STAT, code 144: which slaves have mail, and which are asked (XF EN 1663, XF ZH 1580). The answers to the first
/// and the last form have the bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MailboxStatus {
    /// `par` 0: which mailboxes are full, in OP.
    ReadFlags,
    /// `par` 1: which mailboxes the chip polls, from the next [`Reconfig`](super::Reconfig) on. The data are the bits.
    SetPolling(SlaveBits),
    /// `par` 2: which mailboxes the chip polls.
    ReadPolling,
}

impl Call<'_> for MailboxStatus {
    const CODE: CommandCode = CommandCode::MailboxStatus;
    type Answer<'a> = SlaveBits;

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let (operation, len) = match self {
            Self::ReadFlags => (MailboxStatusOperation::ReadFlags, 0),
            Self::SetPolling(slaves) => (MailboxStatusOperation::SetPolling, slaves.write(data)?),
            Self::ReadPolling => (MailboxStatusOperation::ReadPolling, 0),
        };
        Ok(Arguments::NONE.parameter(operation.code()).len(len))
    }

    fn decode(arguments: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
        Ok(match MailboxStatusOperation::decode(arguments.parameter)? {
            MailboxStatusOperation::ReadFlags => Self::ReadFlags,
            MailboxStatusOperation::SetPolling => Self::SetPolling(SlaveBits::read(data, arguments.len)?),
            MailboxStatusOperation::ReadPolling => Self::ReadPolling,
        })
    }
}
