//! Requests for mailboxes of slaves, and for the emergencies received through them.

use core::fmt;

use super::SlaveNumber;
use crate::xf::fields::FieldKind;
use crate::xf::layout::{FieldContent, FieldDecl, FieldReader, FieldWriter, field_values, layout};
use crate::xf::{Malformed, segment};

/// The maximum number of emergencies that the chip lists.
pub const EMERGENCIES_MAX: usize = 8;

layout! {
    /// COE_EMERGENCY, command code 83: reads the newest emergencies. The parameter byte is the number of emergencies to
    /// read (XF EN 1490).
    pub struct CoeEmergency {
        /// How many of the newest emergencies are read.
        pub count: EmergencyCount = par(),
    }

    /// A range of bytes in a mailbox message.
    pub struct MailboxPart {
        start: PartNumber = info(0).or(0),
        length: PartNumber = info(2).or(0),
    }

    /// RECV_MAILBOX, command code 143: reads a message that a slave has sent by mailbox (XF EN 1646, XF ZH 1563). The
    /// answer to `Read` has the bytes.
    pub enum ReceiveMailbox by operation: u8 = par(), "RECV_MAILBOX operation", "0 request, 1 read" {
        /// Parameter byte 0: the chip fetches the message from a slave's mailbox. Information bytes: `i0` and `i1`:
        /// slave as u16.
        Request = 0 {
            /// The slave from whose mailbox the message is fetched.
            slave: SlaveNumber = info(0).bytes(2).or(0),
        },
        /// Parameter byte 1: reads a part of the fetched message. Information bytes: `i0` and `i1` start, `i2` and `i3`
        /// length.
        Read = 1 (part: MailboxPart),
    }

    /// MBX_STAT, command code 144: reads which slaves have mailbox messages, and sets or reads which mailboxes the chip
    /// polls (XF EN 1663, XF ZH 1580). The answers to `ReadFlags` and `ReadPolling` have one bit per slave.
    pub enum MailboxStatus by operation: u8 = par(),
        "MBX_STAT operation", "0 read flags, 1 set polling, 2 read polling"
    {
        /// Parameter byte 0: reads which mailboxes are full, in OP.
        ReadFlags = 0,
        /// Parameter byte 1: sets which mailboxes the chip polls, from the next [`Reconfig`](super::Reconfig) on. The
        /// data have one bit per slave.
        SetPolling = 1 (slaves: SlaveBits = tail(0)),
        /// Parameter byte 2: reads which mailboxes the chip polls.
        ReadPolling = 2,
    }
}

/// The number of emergencies to read, 1..=8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EmergencyCount(u8);

impl EmergencyCount {
    /// The number `n`; `None` unless it is 1..=8.
    pub const fn new(n: u8) -> Option<Self> {
        if n >= 1 && n as usize <= EMERGENCIES_MAX { Some(Self(n)) } else { None }
    }

    /// The number of emergencies, 1..=8.
    pub const fn get(self) -> u8 {
        self.0
    }
}

impl MailboxPart {
    /// `length` bytes, 0..=63, from byte `start`, 0..=63; `None` for larger values.
    ///
    /// Larger values need the high byte, whose unit is 64 or 256: here the manuals are ambiguous. So a host does not
    /// send them.
    pub const fn new(start: u8, length: u8) -> Option<Self> {
        let part = Self { start: PartNumber(start as u16), length: PartNumber(length as u16) };
        if start < 64 && length < 64 { Some(part) } else { None }
    }

    /// The offset in the mailbox message at which the part begins, in bytes.
    pub const fn start(self) -> u16 {
        self.start.0
    }

    /// The number of bytes in the part.
    pub const fn length(self) -> u16 {
        self.length.0
    }
}

/// A number in two information bytes, up to 16575. `[OURS]` The number is high byte * 64 + low byte, as in the text of
/// the manuals. Their drawing shows a field of 16 bits, in which the high byte would count 256.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct PartNumber(u16);

impl fmt::Debug for PartNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

field_values! {
    PartNumber, 2, FieldKind::Number,
        |number| {
            // For numbers above 255 * 64 + 63 the high byte stays at 255, and the low byte takes the rest: 64 to 255.
            let high = (number.0 / 64).min(255);
            (high << 8 | (number.0 - high * 64)).into()
        },
        |bytes| Ok(PartNumber((bytes >> 8) as u16 * 64 + (bytes & 0xFF) as u16));
    EmergencyCount, 1, FieldKind::Number,
        |count| count.get().into(),
        |count| EmergencyCount::new(count as u8).ok_or(Malformed::only("COE_EMERGENCY count", count, "1 to 8"));
}

/// A set of slaves, one bit each: bit b of byte k is slave 8 k + b.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SlaveBits {
    bits: u128,
    bytes: u8,
}

impl SlaveBits {
    /// The size of a set for 128 slaves, in bytes.
    const MOST: usize = 16;

    /// The empty set for a network of `slaves` slaves, 0..=128; larger numbers count as 128.
    pub const fn for_slaves(slaves: u8) -> Self {
        let bytes = slaves.div_ceil(8);
        Self { bits: 0, bytes: if bytes as usize > Self::MOST { Self::MOST as u8 } else { bytes } }
    }

    /// Adds the slave to the set, which is extended to as many bytes as it needs.
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

    /// The size of the set in bytes, for the length field: 1 for 8 slaves.
    pub const fn bytes(self) -> u8 {
        self.bytes
    }

    /// Reads the set from the valid bytes of an answer, up to 128 slaves.
    pub(in crate::xf) fn read_valid(valid: &[u8]) -> Self {
        let (mut bytes, len) = ([0; Self::MOST], valid.len().min(Self::MOST));
        bytes[..len].copy_from_slice(&valid[..len]);
        Self { bits: u128::from_le_bytes(bytes), bytes: len as u8 }
    }
}

/// As a field, a set always takes 16 bytes of the data segment. The length field only carries [`SlaveBits::bytes`].
impl FieldContent<'_> for SlaveBits {
    const BYTES: u8 = 0;
    const KIND: FieldKind = FieldKind::SlaveSet;

    fn put(&self, _: &FieldDecl, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        segment::put(to.data, &self.bits.to_le_bytes())?;
        to.arguments.len = self.bytes.into();
        Ok(())
    }

    fn take(_: &FieldDecl, from: &FieldReader<'_>) -> Result<Self, Malformed> {
        let bits = u128::from_le_bytes(segment::get(from.data)?);
        Ok(Self { bits, bytes: from.arguments.len.min(Self::MOST as u16) as u8 })
    }
}
