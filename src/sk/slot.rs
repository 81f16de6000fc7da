//! A slot as bytes, and the layouts of its fields. Its size, 12 or 16 bytes, is known at run time only.

use bytemuck::{Pod, Zeroable};

use super::command_table::SlotKind;
use crate::ethercat::coe::ObjectAddress;
pub use crate::ethercat::{I32Le, U16Le, U32Le};

/// The size of a slot in bytes. The pin CONFIG2 of the board selects it (SK-1), and the wire does not show it: the host
/// has to be built or configured for the same size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum SlotSize {
    /// 12 bytes: 42 slots, 504 bytes, up to 40 slaves (CONFIG2 low or floating, the default).
    #[default]
    Bytes12,
    /// 16 bytes: 32 slots, 512 bytes, up to 30 slaves (CONFIG2 high).
    Bytes16,
}

impl SlotSize {
    /// Both slot sizes.
    pub const ALL: [Self; 2] = [Self::Bytes12, Self::Bytes16];

    /// Size of a slot in bytes: 12 or 16.
    pub const fn bytes(self) -> usize {
        match self {
            Self::Bytes12 => 12,
            Self::Bytes16 => 16,
        }
    }

    /// The slot size of `n` bytes; `None` unless `n` is 12 or 16.
    pub const fn from_bytes(n: usize) -> Option<Self> {
        match n {
            12 => Some(Self::Bytes12),
            16 => Some(Self::Bytes16),
            _ => None,
        }
    }

    /// Number of slots in a frame: 42 or 32 (`DEF_MA_MAX`).
    #[doc(alias = "DEF_MA_MAX")]
    pub const fn slots(self) -> usize {
        match self {
            Self::Bytes12 => 42,
            Self::Bytes16 => 32,
        }
    }

    /// Size of a frame in bytes: 504 or 512.
    pub const fn frame_len(self) -> usize {
        self.bytes() * self.slots()
    }

    /// Number of slaves that a board can drive: 40 or 30.
    pub const fn max_slaves(self) -> usize {
        self.slots() - 2
    }

    /// The number of the slot for SDO transfers, the last one: 41 or 31.
    pub const fn sdo_slot(self) -> usize {
        self.slots() - 1
    }

    /// The kind of the slot with this number, 0..=41 (0..=31 in 16-byte mode).
    pub const fn kind_of(self, slot: usize) -> SlotKind {
        match slot {
            0 => SlotKind::Master,
            _ if slot == self.sdo_slot() => SlotKind::Sdo,
            _ => SlotKind::Slave,
        }
    }
}

/// The bytes of a 12-byte slot, which are also the first twelve of a 16-byte slot: `u16 CMD` (here as its two bytes),
/// `u16 Parm`, `u32 Data1`, `u32 Data2`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Slot12 {
    /// Byte 0: command id (low byte of `CMD`).
    pub id: u8,
    /// Byte 1: in a command the command index, in a response the index, the mode or an error code (high byte of `CMD`).
    pub index: u8,
    /// Bytes 2..3. In slot 0 these are two values and not one number: byte 2 is an argument, byte 3 the frame's CRC.
    pub parm: U16Le,
    /// Bytes 4..7: Data1, whose meaning depends on the command.
    pub data1: U32Le,
    /// Bytes 8..11: Data2, whose meaning depends on the command.
    pub data2: U32Le,
}

/// A slot of 16 bytes: the fields of [`Slot12`] and `u32 Data3`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Slot16 {
    /// Bytes 0..11: the fields of a 12-byte slot.
    pub slot: Slot12,
    /// Bytes 12..15: used by the two-channel HSP, reserved otherwise.
    pub data3: U32Le,
}

/// The slot of a two-channel HSP (NEXTW's pulse module) in 16-byte mode (UG17 2.1.15, table 2.16). A command carries
/// targets and digital outputs in it, a response actual positions and digital inputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct TwoChannelSlot {
    /// Byte 0: command id.
    pub id: u8,
    /// Byte 1: the command index or, with firmware 1.5, the mode of operation.
    pub index: u8,
    /// Bytes 2..3: in a response the statusword of axis 1, in a command unused.
    pub parm: U16Le,
    /// Bytes 4..7: axis 1: its target in a command, its actual position in a response.
    pub counts1: I32Le,
    /// Bytes 8..9: axis 1: its digital outputs in a command, its digital inputs in a response.
    pub bits1: U16Le,
    /// Bytes 10..13 (unaligned): axis 2: its target in a command, its actual position in a response.
    pub counts2: I32Le,
    /// Bytes 14..15: axis 2: its digital outputs in a command, its digital inputs in a response.
    pub bits2: U16Le,
}

impl TwoChannelSlot {
    /// The slot without fields that do not fit the slot size: with slots of 12 bytes the fields of axis 2 become 0.
    const fn in_size(self, size: SlotSize) -> Self {
        match size {
            SlotSize::Bytes12 => Self { counts2: I32Le::new(0), bits2: U16Le::new(0), ..self },
            SlotSize::Bytes16 => self,
        }
    }
}

const _: () = assert!(size_of::<Slot12>() == 12 && align_of::<Slot12>() == 1);
const _: () = assert!(size_of::<Slot16>() == 16 && align_of::<Slot16>() == 1);
const _: () = assert!(size_of::<TwoChannelSlot>() == 16 && align_of::<TwoChannelSlot>() == 1);
const _: () = assert!(size_of::<Slot12>() * 42 == 504 && size_of::<Slot16>() * 32 == 512);
const _: () = assert!(SlotSize::Bytes12.frame_len() == 504 && SlotSize::Bytes16.frame_len() == 512);

/// A slot's fields as integers, in the same form for both slot sizes; `data3` is 0 in 12-byte mode.
///
/// Decoding keeps a slot in this form if no guide lists its id.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct RawSlot {
    /// Byte 0: command id.
    pub id: u8,
    /// Byte 1: in a command the command index, in a response the index, the mode or an error code.
    pub index: u8,
    /// Bytes 2..3: Parm, whose meaning depends on the command.
    #[doc(alias = "Pram")]
    pub parm: u16,
    /// Bytes 4..7: Data1, whose meaning depends on the command.
    pub data1: u32,
    /// Bytes 8..11: Data2, whose meaning depends on the command.
    pub data2: u32,
    /// Bytes 12..15: Data3, 0 in 12-byte mode.
    pub data3: u32,
}

impl RawSlot {
    /// All bytes 0: GET_STATUS, no request.
    pub const ZERO: Self = Self { id: 0, index: 0, parm: 0, data1: 0, data2: 0, data3: 0 };

    /// Whether every byte is 0: a command slot with no request, or a response slot that the board has never filled.
    pub const fn is_zero(&self) -> bool {
        self.id == 0 && self.index == 0 && self.parm == 0 && self.data1 == 0 && self.data2 == 0 && self.data3 == 0
    }

    /// The slot's bytes in the layout of a two-channel HSP; axis 2 is 0 in 12-byte mode.
    pub fn two_channel(&self, size: SlotSize) -> TwoChannelSlot {
        bytemuck::cast::<_, TwoChannelSlot>(self.to_wide()).in_size(size)
    }

    /// Converts from the layout of a two-channel HSP; in 12-byte mode axis 2 is left out.
    #[inline]
    pub fn from_two_channel(slot: TwoChannelSlot, size: SlotSize) -> Self {
        Self::from(&bytemuck::cast::<_, Slot16>(slot.in_size(size)))
    }

    /// Bytes 8..9: bits 0..15 of `data2`.
    pub const fn data2_low(&self) -> u16 {
        self.data2 as u16
    }

    /// Bytes 10..11: bits 16..31 of `data2`.
    pub const fn data2_high(&self) -> u16 {
        (self.data2 >> 16) as u16
    }

    /// The wire form of 12 bytes, which leaves `data3` out.
    pub fn to_narrow(&self) -> Slot12 {
        Slot12 {
            id: self.id,
            index: self.index,
            parm: self.parm.into(),
            data1: self.data1.into(),
            data2: self.data2.into(),
        }
    }

    /// The wire form of 16 bytes.
    pub fn to_wide(&self) -> Slot16 {
        Slot16 { slot: self.to_narrow(), data3: self.data3.into() }
    }
}

impl From<&Slot12> for RawSlot {
    fn from(s: &Slot12) -> Self {
        Self { id: s.id, index: s.index, parm: s.parm.get(), data1: s.data1.get(), data2: s.data2.get(), data3: 0 }
    }
}

impl From<&Slot16> for RawSlot {
    fn from(s: &Slot16) -> Self {
        Self { data3: s.data3.get(), ..Self::from(&s.slot) }
    }
}

/// The slots of a frame, borrowed from its bytes without a copy.
#[derive(Clone, Copy, Debug)]
pub enum Slots<'a> {
    /// 42 slots of 12 bytes.
    Narrow(&'a [Slot12; 42]),
    /// 32 slots of 16 bytes.
    Wide(&'a [Slot16; 32]),
}

impl<'a> Slots<'a> {
    /// A copy of slot `i`.
    ///
    /// # Panics
    /// If the frame has no slot `i`.
    pub fn get(&self, i: usize) -> RawSlot {
        match self {
            Self::Narrow(s) => RawSlot::from(&s[i]),
            Self::Wide(s) => RawSlot::from(&s[i]),
        }
    }

    /// The first twelve bytes of slot `i`, borrowed from the frame.
    ///
    /// # Panics
    /// If the frame has no slot `i`.
    pub fn head(&self, i: usize) -> &'a Slot12 {
        match self {
            Self::Narrow(s) => &s[i],
            Self::Wide(s) => &s[i].slot,
        }
    }

    /// Copies of all slots in order, slot 0 first.
    pub fn iter(&self) -> impl Iterator<Item = RawSlot> + use<'a> {
        let slots = *self;
        let n = match slots {
            Self::Narrow(_) => 42,
            Self::Wide(_) => 32,
        };
        (0..n).map(move |i| slots.get(i))
    }
}

/// Data1 of the SDO slot for this object: `index << 16 | sub-index`.
pub(super) const fn object_word(object: ObjectAddress) -> u32 {
    (object.index as u32) << 16 | object.sub as u32
}
