//! Mailboxes of slaves, and the emergencies that came through them.

use core::fmt;

use super::SlaveNumber;
use crate::xf::fields::Kind;
use crate::xf::layout::{Part, Reader, Spot, Writer, field_values, layout};
use crate::xf::{Malformed, segment};

/// The most emergencies that the chip lists.
pub const EMERGENCIES_MAX: usize = 8;

layout! {
    /// COE_EMERGENCY, code 83: the newest emergencies. `par` how many (XF EN 1490).
    pub struct CoeEmergency {
        /// How many.
        pub count: EmergencyCount = par(),
    }

    /// A part of a mailbox.
    pub struct MailboxPart {
        start: PartNumber = info(0).or(0),
        length: PartNumber = info(2).or(0),
    }

    /// RECV_MAILBOX, code 143: what a slave sent by mailbox (XF EN 1646, XF ZH 1563). The answer to the second form has the
    /// bytes.
    pub enum ReceiveMailbox by operation: u8 = par(), "RECV_MAILBOX operation", "0 request, 1 read" {
        /// `par` 0: the chip fetches a slave's mailbox. `i0`, `i1` u16 slave.
        Request = 0 {
            /// Which slave.
            slave: SlaveNumber = info(0).bytes(2).or(0),
        },
        /// `par` 1: a part of what it fetched. `i0`, `i1` start, `i2`, `i3` length.
        Read = 1 (part: MailboxPart),
    }

    /// MBX_STAT, code 144: which slaves have mail, and which are asked (XF EN 1663, XF ZH 1580). The answers to the first
    /// and the last form have the bits.
    pub enum MailboxStatus by operation: u8 = par(),
        "MBX_STAT operation", "0 read flags, 1 set polling, 2 read polling"
    {
        /// `par` 0: which mailboxes are full, in OP.
        ReadFlags = 0,
        /// `par` 1: which mailboxes the chip polls, from the next [`Reconfig`](super::Reconfig) on. The data are the bits.
        SetPolling = 1 (slaves: SlaveBits = tail(0)),
        /// `par` 2: which mailboxes the chip polls.
        ReadPolling = 2,
    }
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

impl MailboxPart {
    /// From byte `start`, 0..=63, so many bytes, 0..=63; `None` for others.
    ///
    /// Above these the manuals can be read in two ways, as 64 or as 256 times the high byte, so that a host does not
    /// ask for them.
    pub const fn new(start: u8, length: u8) -> Option<Self> {
        let part = Self { start: PartNumber(start as u16), length: PartNumber(length as u16) };
        if start < 64 && length < 64 { Some(part) } else { None }
    }

    /// The first byte.
    pub const fn start(self) -> u16 {
        self.start.0
    }

    /// How many bytes.
    pub const fn length(self) -> u16 {
        self.length.0
    }
}

/// A number in two information bytes, up to 16575. `[OURS]` As the manuals' text has it, high * 64 + low; their drawing
/// shows a field of 16 bits, where the high byte would count 256.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct PartNumber(u16);

impl fmt::Debug for PartNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

field_values! {
    PartNumber, 2, Kind::Number,
        |number| {
            // The largest number, 255 * 64 + 255, has no low part below 64.
            let high = (number.0 / 64).min(255);
            (high << 8 | (number.0 - high * 64)).into()
        },
        |bytes| Ok(PartNumber((bytes >> 8) as u16 * 64 + (bytes & 0xFF) as u16));
    EmergencyCount, 1, Kind::Number,
        |count| count.get().into(),
        |count| EmergencyCount::new(count as u8).ok_or(Malformed::only("COE_EMERGENCY count", count, "1 to 8"));
}

/// A bit for each slave: bit b of byte k is slave 8 k + b.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SlaveBits {
    bits: u128,
    bytes: u8,
}

impl SlaveBits {
    /// The bytes of a set for 128 slaves.
    const MOST: usize = 16;

    /// No slave of a network of so many, 0..=128; more count as 128.
    pub const fn for_slaves(slaves: u8) -> Self {
        let bytes = slaves.div_ceil(8);
        Self { bits: 0, bytes: if bytes as usize > Self::MOST { Self::MOST as u8 } else { bytes } }
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

    /// Reads the bytes that an answer has, those for the first 128 slaves.
    pub(in crate::xf) fn read_valid(valid: &[u8]) -> Self {
        let (mut bytes, len) = ([0; Self::MOST], valid.len().min(Self::MOST));
        bytes[..len].copy_from_slice(&valid[..len]);
        Self { bits: u128::from_le_bytes(bytes), bytes: len as u8 }
    }
}

/// All 16 bytes, whatever the length field counts.
impl Part<'_> for SlaveBits {
    const BYTES: u8 = 0;
    const KIND: Kind = Kind::SlaveSet;

    fn put(&self, _: &Spot, to: &mut Writer<'_>) -> Result<(), Malformed> {
        segment::put(to.data, &self.bits.to_le_bytes())?;
        to.arguments.len = self.bytes.into();
        Ok(())
    }

    fn take(_: &Spot, from: &Reader<'_>) -> Result<Self, Malformed> {
        let bits = u128::from_le_bytes(segment::get(from.data)?);
        Ok(Self { bits, bytes: from.arguments.len.min(Self::MOST as u16) as u8 })
    }
}
