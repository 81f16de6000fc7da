//! Ethernet frames that carry EtherCAT: the two headers, and a writer that appends datagrams to a frame.
//!
//! VLAN tags and EtherCAT over UDP are not supported. Source: ETG.1000.4 5.3; rules ECAT-1.

use bytemuck::{Pod, Zeroable};

use super::datagram::{DATAGRAM_HEADER_LEN, DATAGRAM_OVERHEAD, DatagramMut, Datagrams};
use super::wire_error::{room_for, split};
use super::{DatagramHeader, U16Le, WireError};

/// The EtherType of EtherCAT. On the wire its upper byte comes first.
pub const ETHERTYPE: u16 = 0x88A4;
/// The destination MAC address that masters use: broadcast.
pub const BROADCAST: [u8; 6] = [0xFF; 6];
/// Length of the Ethernet header in bytes.
pub const ETHERNET_HEADER_LEN: usize = 14;
/// Length in bytes of the Ethernet header and the EtherCAT header.
pub const FRAME_HEADER_LEN: usize = ETHERNET_HEADER_LEN + 2;
/// Minimum length in bytes of an Ethernet frame, without its check sequence.
pub const FRAME_LEN_MIN: usize = 60;
/// Maximum length in bytes of an Ethernet frame, without its check sequence.
pub const FRAME_LEN_MAX: usize = 1514;
/// Maximum number of data bytes in one datagram.
pub const DATA_LEN_MAX: usize = FRAME_LEN_MAX - FRAME_HEADER_LEN - DATAGRAM_OVERHEAD;

/// Wire layout of the two headers. The comments of the fields give byte offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// Bytes 0..=5: destination MAC address.
    destination: [u8; 6],
    /// Bytes 6..=11: source MAC address.
    source: [u8; 6],
    /// Bytes 12..=13: EtherType, big endian.
    ethertype: [u8; 2],
    /// Bytes 14..=15: bits 0..=10 length of the EtherCAT payload, bit 11 reserved, bits 12..=15 protocol.
    ethercat: U16Le,
}

const _: () = assert!(size_of::<Layout>() == FRAME_HEADER_LEN && align_of::<Layout>() == 1);
const _: () = assert!(DATA_LEN_MAX == 1486);

/// The protocol type in an EtherCAT header (ETG.1000.4 table 9).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Protocol {
    /// 1: EtherCAT datagrams.
    Datagrams,
    /// 4: network variables.
    NetworkVariables,
    /// 5: the mailbox gateway.
    MailboxGateway,
    /// Any other value, 0..=15.
    Unknown(u8),
}

impl Protocol {
    /// The protocol with this code on the wire. Only the lower 4 bits of the code are used.
    pub const fn from_code(code: u8) -> Self {
        match code & 0x0F {
            1 => Self::Datagrams,
            4 => Self::NetworkVariables,
            5 => Self::MailboxGateway,
            code => Self::Unknown(code),
        }
    }

    /// The code on the wire, 0..=15.
    pub const fn code(self) -> u8 {
        match self {
            Self::Datagrams => 1,
            Self::NetworkVariables => 4,
            Self::MailboxGateway => 5,
            Self::Unknown(code) => code & 0x0F,
        }
    }
}

/// The Ethernet header with the EtherCAT header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FrameHeader {
    /// Destination MAC address. Slaves process frames to any destination.
    pub destination: [u8; 6],
    /// Source MAC address. The first slave that a frame passes sets bit 1 of the first byte.
    pub source: [u8; 6],
    /// Length of the EtherCAT payload in bytes, 0..=2047. Bytes after the payload are padding.
    pub len: u16,
    /// Bit 11 of the EtherCAT header, which is reserved.
    pub reserved: bool,
    /// The protocol of the payload.
    pub protocol: Protocol,
}

impl FrameHeader {
    /// The bit that slaves set in the first byte of the source MAC address: "locally administered".
    pub const PASSED_A_SLAVE: u8 = 0x02;
    const LEN: u16 = 0x07FF;
    const RESERVED: u16 = 1 << 11;

    /// The header of a broadcast frame that carries datagrams.
    pub const fn datagrams(source: [u8; 6]) -> Self {
        Self { destination: BROADCAST, source, len: 0, reserved: false, protocol: Protocol::Datagrams }
    }

    /// Decodes the headers.
    ///
    /// # Errors
    /// [`WireError::Field`]: the EtherType is not that of EtherCAT.
    pub fn decode(bytes: &[u8; FRAME_HEADER_LEN]) -> Result<Self, WireError> {
        let layout: &Layout = bytemuck::cast_ref(bytes);
        let ethertype = u16::from_be_bytes(layout.ethertype);
        if ethertype != ETHERTYPE {
            return Err(WireError::Field { part: "EtherType", found: ethertype.into(), allowed: "0x88A4" });
        }
        let word = layout.ethercat.get();
        Ok(Self {
            destination: layout.destination,
            source: layout.source,
            len: word & Self::LEN,
            reserved: word & Self::RESERVED != 0,
            protocol: Protocol::from_code((word >> 12) as u8),
        })
    }

    /// Encodes the headers. Bits of `len` beyond the 11-bit field are dropped.
    pub fn encode(&self) -> [u8; FRAME_HEADER_LEN] {
        let reserved = if self.reserved { Self::RESERVED } else { 0 };
        let word = self.len & Self::LEN | reserved | u16::from(self.protocol.code()) << 12;
        bytemuck::cast(Layout {
            destination: self.destination,
            source: self.source,
            ethertype: ETHERTYPE.to_be_bytes(),
            ethercat: word.into(),
        })
    }
}

/// A received frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Frame<'a> {
    /// The headers.
    pub header: FrameHeader,
    /// The EtherCAT payload, without padding.
    pub payload: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Decodes a frame without its check sequence. The EtherCAT header, not the length of `bytes`, gives the length of the
    /// payload.
    ///
    /// # Errors
    /// [`WireError::Short`]: the bytes end before the payload does. [`WireError::Field`]: the EtherType is not that of
    /// EtherCAT.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, WireError> {
        let (header, rest) = split(bytes, "headers of a frame")?;
        let header = FrameHeader::decode(header)?;
        let needed = usize::from(header.len);
        let short = WireError::Short { part: "payload of a frame", needed, found: rest.len() };
        Ok(Self { header, payload: rest.get(..needed).ok_or(short)? })
    }

    /// The datagrams; `None` if the frame carries another protocol.
    pub const fn datagrams(&self) -> Option<Datagrams<'a>> {
        match self.header.protocol {
            Protocol::Datagrams => Some(Datagrams::new(self.payload)),
            _ => None,
        }
    }
}

/// Calls `visit` for each datagram of a frame, in place. Stops at the first error.
///
/// # Errors
/// As [`Frame::decode`]; [`WireError::Short`] if a datagram is longer than the rest of the frame.
pub fn each_datagram(frame: &mut [u8], mut visit: impl FnMut(DatagramMut<'_>)) -> Result<(), WireError> {
    let len = Frame::decode(frame)?.payload.len();
    let mut rest = &mut frame[FRAME_HEADER_LEN..][..len];
    loop {
        let (datagram, behind) = DatagramMut::split(rest)?;
        let more = datagram.header().more;
        visit(datagram);
        if !more {
            return Ok(());
        }
        rest = behind;
    }
}

/// Sets bit 1 of the first byte of a frame's source address, as the first slave that a frame passes does. A slice that
/// ends before the source address is no frame, and stays unchanged.
pub fn mark_as_passed(frame: &mut [u8]) {
    const SOURCE: usize = 6;
    if let Some(byte) = frame.get_mut(SOURCE) {
        *byte |= FrameHeader::PASSED_A_SLAVE;
    }
}

/// Builds a frame in a buffer by appending datagrams.
///
/// ```
/// use ecmsk::ethercat::{Command, DatagramHeader, Frame, FrameHeader, FrameWriter};
///
/// let mut buffer = [0xA5; 1514];
/// let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams([0x10; 6]))?;
/// frame.push(DatagramHeader::register(Command::Brd, 7, 0, 0x0130), &[0, 0])?;
/// let sent = frame.finish();
/// assert_eq!(sent.len(), 60);
///
/// let received = Frame::decode(sent)?;
/// let first = received.datagrams().and_then(|mut all| all.next()).expect("one datagram")?;
/// assert_eq!((first.header.command, first.header.ado(), first.data.len()), (Command::Brd, 0x0130, 2));
/// # Ok::<(), ecmsk::ethercat::WireError>(())
/// ```
#[derive(Debug)]
pub struct FrameWriter<'b> {
    buffer: &'b mut [u8],
    header: FrameHeader,
    /// Offset in `buffer` of the header of the newest datagram; `None`: the frame has no datagram yet.
    newest: Option<usize>,
    end: usize,
}

impl<'b> FrameWriter<'b> {
    /// Begins a frame in a buffer. The writer replaces the length in `header` by the actual one.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the buffer is shorter than the shortest Ethernet frame.
    pub fn new(buffer: &'b mut [u8], header: FrameHeader) -> Result<Self, WireError> {
        room_for(buffer, "frame", FRAME_LEN_MIN)?;
        let len = buffer.len().min(FRAME_LEN_MAX);
        Ok(Self { buffer: &mut buffer[..len], header, newest: None, end: FRAME_HEADER_LEN })
    }

    /// The number of data bytes that one more datagram can carry; `None` if no datagram fits.
    pub const fn room(&self) -> Option<usize> {
        self.buffer.len().checked_sub(self.end + DATAGRAM_OVERHEAD)
    }

    /// Appends a datagram with working counter 0. The writer sets the length and the "more" flag of the headers.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the frame would exceed the buffer or the maximum length of a frame.
    pub fn push(&mut self, header: DatagramHeader, data: &[u8]) -> Result<(), WireError> {
        let needed = data.len() + DATAGRAM_OVERHEAD;
        let place = room_for(&mut self.buffer[self.end..], "datagram", needed)?;
        let header = DatagramHeader { len: data.len() as u16, more: false, ..header };
        place[..DATAGRAM_HEADER_LEN].copy_from_slice(&header.encode());
        place[DATAGRAM_HEADER_LEN..][..data.len()].copy_from_slice(data);
        place[needed - 2..].fill(0);
        if let Some(before) = self.newest.replace(self.end)
            && let Some(bytes) = self.buffer[before..].first_chunk_mut()
        {
            *bytes = DatagramHeader { more: true, ..DatagramHeader::decode(bytes) }.encode();
        }
        self.end += needed;
        Ok(())
    }

    /// Returns the frame, zero-padded to the minimum length of an Ethernet frame.
    pub fn finish(self) -> &'b [u8] {
        let len = (self.end - FRAME_HEADER_LEN) as u16;
        self.buffer[..FRAME_HEADER_LEN].copy_from_slice(&FrameHeader { len, ..self.header }.encode());
        let whole = self.end.max(FRAME_LEN_MIN);
        self.buffer[self.end..whole].fill(0);
        &self.buffer[..whole]
    }
}
