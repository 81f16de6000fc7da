//! Datagrams: the commands, the 10-byte header, the data and the working counter.
//!
//! Source: ETG.1000.4 5.4; rules ECAT-1.

use bytemuck::{Pod, Zeroable};

use super::wire_error::split;
use super::{U16Le, U32Le, WireError};

/// Length of a datagram header in bytes.
pub const DATAGRAM_HEADER_LEN: usize = 10;
/// Bytes of a datagram besides its data: the header and the working counter.
pub const DATAGRAM_OVERHEAD: usize = DATAGRAM_HEADER_LEN + 2;

/// How a command addresses slaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Addressing {
    /// The command addresses no slave.
    None,
    /// Position addressing (auto increment): addresses the slave that receives the position field as 0. Each slave adds
    /// 1 to the field, so the master sends the negated position of the slave.
    Position,
    /// Node addressing: addresses the slave with that station address.
    Node,
    /// Addresses all slaves. Each slave adds 1 to the position field, so that the master can count the slaves.
    Broadcast,
    /// Logical addressing: addresses the slaves whose FMMUs map the logical address.
    Logical,
}

/// Defines the commands from a table with name, code, abbreviation and addressing.
macro_rules! commands {
    ($($(#[$doc:meta])* $name:ident = $code:literal, $short:literal, $addressing:ident;)*) => {
        /// The command of a datagram (ETG.1000.4 table 10).
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Command {
            $($(#[$doc])* $name,)*
            /// A code that the standard does not define. Slaves forward such a datagram unchanged.
            Unknown(u8),
        }

        impl Command {
            /// All commands of the standard.
            pub const ALL: [Self; 15] = [$(Self::$name,)*];

            /// The command with this code on the wire.
            pub const fn from_code(code: u8) -> Self {
                match code {
                    $($code => Self::$name,)*
                    code => Self::Unknown(code),
                }
            }

            /// The code on the wire.
            pub const fn code(self) -> u8 {
                match self {
                    $(Self::$name => $code,)*
                    Self::Unknown(code) => code,
                }
            }

            /// The usual abbreviation, as in `LRW`.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$name => $short,)*
                    Self::Unknown(_) => "unknown",
                }
            }

            /// How the command addresses slaves.
            pub const fn addressing(self) -> Addressing {
                match self {
                    $(Self::$name => Addressing::$addressing,)*
                    Self::Unknown(_) => Addressing::None,
                }
            }
        }
    };
}

commands! {
    /// No operation: slaves ignore the datagram.
    Nop = 0, "NOP", None;
    /// Auto increment read.
    Aprd = 1, "APRD", Position;
    /// Auto increment write.
    Apwr = 2, "APWR", Position;
    /// Auto increment read and write.
    Aprw = 3, "APRW", Position;
    /// Configured address read.
    Fprd = 4, "FPRD", Node;
    /// Configured address write.
    Fpwr = 5, "FPWR", Node;
    /// Configured address read and write.
    Fprw = 6, "FPRW", Node;
    /// Broadcast read: each slave ORs its data into the datagram.
    Brd = 7, "BRD", Broadcast;
    /// Broadcast write.
    Bwr = 8, "BWR", Broadcast;
    /// Broadcast read and write.
    Brw = 9, "BRW", Broadcast;
    /// Logical memory read.
    Lrd = 10, "LRD", Logical;
    /// Logical memory write.
    Lwr = 11, "LWR", Logical;
    /// Logical memory read and write.
    Lrw = 12, "LRW", Logical;
    /// Auto increment read, multiple write: the addressed slave is read, all others are written.
    Armw = 13, "ARMW", Position;
    /// Configured address read, multiple write.
    Frmw = 14, "FRMW", Node;
}

/// Wire layout of a datagram header. The comments of the fields give byte offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// Byte 0: command code.
    command: u8,
    /// Byte 1: index.
    index: u8,
    /// Bytes 2..=5: ADP and ADO, or the logical address.
    address: U32Le,
    /// Bytes 6..=7: bits 0..=10 length, 11..=13 reserved, 14 circulating, 15 more datagrams follow.
    len: U16Le,
    /// Bytes 8..=9: event bits.
    irq: U16Le,
}

const _: () = assert!(size_of::<Layout>() == DATAGRAM_HEADER_LEN && align_of::<Layout>() == 1);

/// The header of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DatagramHeader {
    /// The command.
    pub command: Command,
    /// A number that slaves do not change. The master uses it to recognise the returning datagram.
    pub index: u8,
    /// ADP in the lower and ADO in the upper 16 bits, or the logical address.
    pub address: u32,
    /// Length of the data in bytes, 0..=2047.
    pub len: u16,
    /// Bits 11 to 13 of the length word, which are reserved, 0..=7.
    pub reserved: u8,
    /// The frame has passed a slave whose port 0 has no link, so it may circulate in a part of the network that is cut
    /// off from the master. A second slave without a link at port 0 destroys the frame.
    pub circulating: bool,
    /// Another datagram follows in the frame.
    pub more: bool,
    /// The ORed event bits of all slaves, see [`registers::ECAT_EVENT`](super::registers::ECAT_EVENT).
    pub irq: u16,
}

impl DatagramHeader {
    /// Maximum value of the 11-bit length field.
    pub const LEN_MAX: u16 = 0x07FF;
    const CIRCULATING: u16 = 1 << 14;
    const MORE: u16 = 1 << 15;

    /// A header with a raw 32-bit address. [`FrameWriter`](super::FrameWriter) fills in the length and the "more" flag.
    pub const fn new(command: Command, index: u8, address: u32) -> Self {
        Self { command, index, address, len: 0, reserved: 0, circulating: false, more: false, irq: 0 }
    }

    /// A header that accesses address `ado` in the memory of one slave. `adp` is the slave's station address, or the
    /// negated position of the slave in the network (0, 0xFFFF, 0xFFFE, ...).
    pub const fn register(command: Command, index: u8, adp: u16, ado: u16) -> Self {
        Self::new(command, index, adp as u32 | (ado as u32) << 16)
    }

    /// The lower half of the address (ADP): the station address, or the negated position of the slave plus 1 for each
    /// slave passed.
    pub const fn adp(&self) -> u16 {
        self.address as u16
    }

    /// The upper half of the address: the address in the memory of a slave.
    pub const fn ado(&self) -> u16 {
        (self.address >> 16) as u16
    }

    /// This header with another lower half of the address.
    #[must_use]
    pub const fn with_adp(mut self, adp: u16) -> Self {
        self.address = self.address & 0xFFFF_0000 | adp as u32;
        self
    }

    /// Decodes a header. Every bit pattern is valid.
    pub fn decode(bytes: &[u8; DATAGRAM_HEADER_LEN]) -> Self {
        let layout: &Layout = bytemuck::cast_ref(bytes);
        let word = layout.len.get();
        Self {
            command: Command::from_code(layout.command),
            index: layout.index,
            address: layout.address.get(),
            len: word & Self::LEN_MAX,
            reserved: (word >> 11) as u8 & 0b111,
            circulating: word & Self::CIRCULATING != 0,
            more: word & Self::MORE != 0,
            irq: layout.irq.get(),
        }
    }

    /// Encodes the header. Bits of `len` and `reserved` that do not fit into their fields are dropped.
    pub fn encode(&self) -> [u8; DATAGRAM_HEADER_LEN] {
        let mut word = self.len & Self::LEN_MAX | u16::from(self.reserved & 0b111) << 11;
        if self.circulating {
            word |= Self::CIRCULATING;
        }
        if self.more {
            word |= Self::MORE;
        }
        bytemuck::cast(Layout {
            command: self.command.code(),
            index: self.index,
            address: self.address.into(),
            len: word.into(),
            irq: self.irq.into(),
        })
    }
}

/// A received datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Datagram<'a> {
    /// The header.
    pub header: DatagramHeader,
    /// The data; the header gives their length.
    pub data: &'a [u8],
    /// The working counter. Each slave adds to it when it has handled the datagram.
    pub working_counter: u16,
}

impl<'a> Datagram<'a> {
    /// Splits off the first datagram in `bytes`; also returns the bytes after it.
    ///
    /// # Errors
    /// [`WireError::Short`]: the bytes end before the datagram does.
    pub fn split(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), WireError> {
        let (header, rest) = split(bytes, "datagram header")?;
        let header = DatagramHeader::decode(header);
        let len = usize::from(header.len);
        let (data, rest) = rest.split_at_checked(len).ok_or_else(|| short(len, rest))?;
        let (counter, rest) = split(rest, "working counter")?;
        Ok((Self { header, data, working_counter: u16::from_le_bytes(*counter) }, rest))
    }
}

fn short(len: usize, rest: &[u8]) -> WireError {
    WireError::Short { part: "data of a datagram", needed: len, found: rest.len() }
}

/// Iterator over the datagrams of a frame, in their order. If decoding fails, the error is the last item. See
/// [`Frame::datagrams`](super::Frame::datagrams).
#[derive(Clone, Debug)]
pub struct Datagrams<'a> {
    rest: Option<&'a [u8]>,
}

impl<'a> Datagrams<'a> {
    /// Iterates over `bytes`, which begin with a datagram header. Bytes after the last datagram are ignored.
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { rest: Some(bytes) }
    }
}

impl<'a> Iterator for Datagrams<'a> {
    type Item = Result<Datagram<'a>, WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        let split = Datagram::split(self.rest.take()?);
        Some(split.map(|(datagram, rest)| {
            self.rest = datagram.header.more.then_some(rest);
            datagram
        }))
    }
}

/// A mutable view of a datagram in a frame, for slaves and slave models, which change a frame while it passes them.
#[derive(Debug)]
pub struct DatagramMut<'a> {
    header: &'a mut [u8; DATAGRAM_HEADER_LEN],
    /// The data; the header gives their length.
    pub data: &'a mut [u8],
    working_counter: &'a mut [u8; 2],
}

impl<'a> DatagramMut<'a> {
    /// Splits off the first datagram in `bytes`; also returns the bytes after it.
    ///
    /// # Errors
    /// [`WireError::Short`]: the bytes end before the datagram does.
    pub fn split(bytes: &'a mut [u8]) -> Result<(Self, &'a mut [u8]), WireError> {
        let found = bytes.len();
        let short = |part, needed| WireError::Short { part, needed, found };
        let (header, rest) = bytes.split_first_chunk_mut().ok_or(short("datagram header", DATAGRAM_HEADER_LEN))?;
        let len = usize::from(DatagramHeader::decode(header).len);
        let (data, rest) = rest.split_at_mut_checked(len).ok_or(short("datagram", len + DATAGRAM_OVERHEAD))?;
        let (working_counter, rest) = rest.split_first_chunk_mut().ok_or(short("datagram", len + DATAGRAM_OVERHEAD))?;
        Ok((Self { header, data, working_counter }, rest))
    }

    /// Decodes the header in its current state.
    pub fn header(&self) -> DatagramHeader {
        DatagramHeader::decode(self.header)
    }

    /// Replaces the lower half of the address.
    pub fn set_adp(&mut self, adp: u16) {
        *self.header = self.header().with_adp(adp).encode();
    }

    /// Sets the circulating bit of the header.
    pub fn set_circulating(&mut self) {
        *self.header = DatagramHeader { circulating: true, ..self.header() }.encode();
    }

    /// ORs event bits into the `irq` field.
    pub fn add_events(&mut self, events: u16) {
        if events != 0 {
            let header = self.header();
            *self.header = DatagramHeader { irq: header.irq | events, ..header }.encode();
        }
    }

    /// The current value of the working counter.
    pub const fn working_counter(&self) -> u16 {
        u16::from_le_bytes(*self.working_counter)
    }

    /// Adds `n` to the working counter, with wrap-around.
    pub const fn count(&mut self, n: u16) {
        *self.working_counter = self.working_counter().wrapping_add(n).to_le_bytes();
    }
}
