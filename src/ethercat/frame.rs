//! Ethernet frames with EtherCAT in them: the two headers, and a writer that puts datagrams behind each other.
//!
//! VLAN tags and EtherCAT over UDP are no frames here. Source: ETG.1000.4 5.3; rules ECAT-1.

use bytemuck::{Pod, Zeroable};

use super::datagram::{DATAGRAM_HEADER_LEN, DATAGRAM_OVERHEAD, DatagramMut, Datagrams};
use super::wire_error::{room_for, split};
use super::{DatagramHeader, U16Le, WireError};

/// The EtherType of EtherCAT. On the wire its upper byte comes first.
pub const ETHERTYPE: u16 = 0x88A4;
/// The destination that masters use: all stations.
pub const BROADCAST: [u8; 6] = [0xFF; 6];
/// Bytes of the Ethernet header.
pub const ETHERNET_HEADER_LEN: usize = 14;
/// Bytes of the two headers in front of the first datagram.
pub const FRAME_HEADER_LEN: usize = ETHERNET_HEADER_LEN + 2;
/// The shortest Ethernet frame, without its check sequence.
pub const FRAME_LEN_MIN: usize = 60;
/// The longest Ethernet frame, without its check sequence.
pub const FRAME_LEN_MAX: usize = 1514;
/// The most data that one datagram of a frame can have.
pub const DATA_LEN_MAX: usize = FRAME_LEN_MAX - FRAME_HEADER_LEN - DATAGRAM_OVERHEAD;

/// The two headers as bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// 0..=5.
    destination: [u8; 6],
    /// 6..=11.
    source: [u8; 6],
    /// 12..=13, big endian.
    ethertype: [u8; 2],
    /// 14..=15: bits 0..=10 length of what follows, bit 11 reserved, bits 12..=15 kind.
    ethercat: U16Le,
}

const _: () = assert!(size_of::<Layout>() == FRAME_HEADER_LEN && align_of::<Layout>() == 1);
const _: () = assert!(DATA_LEN_MAX == 1486);

/// What an EtherCAT header announces (ETG.1000.4 table 9).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Protocol {
    /// 1: datagrams.
    Datagrams,
    /// 4: network variables.
    NetworkVariables,
    /// 5: the mailbox gateway.
    MailboxGateway,
    /// Another value, 0..=15.
    Unknown(u8),
}

impl Protocol {
    /// The protocol with that code; of the code the lower 4 bits count.
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

/// The Ethernet header and the EtherCAT header behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FrameHeader {
    /// The destination. Slaves take frames to any.
    pub destination: [u8; 6],
    /// The source. The first slave that a frame passes sets bit 1 of the first byte.
    pub source: [u8; 6],
    /// How many bytes follow the header that belong to EtherCAT, 0..=2047. What follows behind them is padding.
    pub len: u16,
    /// Bit 11 of the EtherCAT header, which has no meaning.
    pub reserved: bool,
    /// What follows.
    pub protocol: Protocol,
}

impl FrameHeader {
    /// The bit of the first byte of the source that slaves set: locally administered.
    pub const PASSED_A_SLAVE: u8 = 0x02;
    const LEN: u16 = 0x07FF;
    const RESERVED: u16 = 1 << 11;

    /// The header of a frame with datagrams to all stations.
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

    /// The headers as bytes. Of `len` the bits count that the field has.
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

/// A frame that was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Frame<'a> {
    /// The headers.
    pub header: FrameHeader,
    /// What belongs to EtherCAT behind the headers, without padding.
    pub payload: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Decodes a frame, without its check sequence. Its length is what the EtherCAT header says, not that of `bytes`.
    ///
    /// # Errors
    /// [`WireError::Short`], [`WireError::Field`]: it is no frame of EtherCAT, or shorter than it says.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, WireError> {
        let (header, rest) = split(bytes, "headers of a frame")?;
        let header = FrameHeader::decode(header)?;
        let needed = usize::from(header.len);
        let short = WireError::Short { part: "payload of a frame", needed, found: rest.len() };
        Ok(Self { header, payload: rest.get(..needed).ok_or(short)? })
    }

    /// The datagrams, if the frame has such.
    pub const fn datagrams(&self) -> Option<Datagrams<'a>> {
        match self.header.protocol {
            Protocol::Datagrams => Some(Datagrams::new(self.payload)),
            _ => None,
        }
    }
}

/// Calls `visit` with each datagram in the bytes of a frame. The first error ends it.
///
/// # Errors
/// As [`Frame::decode`]; [`WireError::Short`] from a datagram that is longer than what is left of the frame.
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

/// Sets the bit of a frame's source by which a master knows that the frame has passed a slave. A frame without a source
/// stays as it is.
pub fn mark_as_passed(frame: &mut [u8]) {
    const SOURCE: usize = 6;
    if let Some(byte) = frame.get_mut(SOURCE) {
        *byte |= FrameHeader::PASSED_A_SLAVE;
    }
}

/// Puts datagrams behind each other into a buffer.
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
    /// Where the newest datagram begins.
    newest: Option<usize>,
    end: usize,
}

impl<'b> FrameWriter<'b> {
    /// Begins a frame in a buffer. The header's length is counted anew.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the buffer is shorter than the shortest frame.
    pub fn new(buffer: &'b mut [u8], header: FrameHeader) -> Result<Self, WireError> {
        room_for(buffer, "frame", FRAME_LEN_MIN)?;
        let len = buffer.len().min(FRAME_LEN_MAX);
        Ok(Self { buffer: &mut buffer[..len], header, newest: None, end: FRAME_HEADER_LEN })
    }

    /// How many bytes of data another datagram could have; `None`: there is no room for one.
    pub const fn room(&self) -> Option<usize> {
        self.buffer.len().checked_sub(self.end + DATAGRAM_OVERHEAD)
    }

    /// Adds a datagram with the working counter 0. Its length, and whether others follow, are set here.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the frame would be longer than the buffer or than a frame can be.
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

    /// The frame, padded with zeros to the shortest length that Ethernet has.
    pub fn finish(self) -> &'b [u8] {
        let len = (self.end - FRAME_HEADER_LEN) as u16;
        self.buffer[..FRAME_HEADER_LEN].copy_from_slice(&FrameHeader { len, ..self.header }.encode());
        let whole = self.end.max(FRAME_LEN_MIN);
        self.buffer[self.end..whole].fill(0);
        &self.buffer[..whole]
    }
}
