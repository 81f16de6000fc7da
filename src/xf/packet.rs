//! Packets: building them in the caller's buffer, and parsing them.
//!
//! Both directions have the same layout: header 24 bytes, data segment n, check word 4, end word 4 (XF EN 174, figure
//! 3).

use core::fmt;

use super::check::{CheckResult, CheckRule, CrcCoverage, check_answer};
use super::check_type::CheckType;
use super::header::{AnswerHeader, CommandHeader, Status};
use super::request::{Arguments, Call, Encode, Request};
use super::response::{Answer, Returned};
use super::{CommandCode, DataSize, END_WORD, HEADER_LEN, Malformed, NOT_READY, START_WORD};

/// Why bytes are not a valid packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketError {
    /// The number of bytes is not the length of a packet.
    Length {
        /// The length of a packet, n + 32.
        expected: usize,
        /// The number of bytes given.
        found: usize,
    },
    /// The first word is not [`START_WORD`].
    StartWord {
        /// The first word of the bytes.
        found: u32,
    },
    /// The last word is not [`END_WORD`].
    EndWord {
        /// The last word of the bytes.
        found: u32,
    },
    /// The check word does not match the bytes.
    CheckWord {
        /// The type of the check word.
        kind: CheckType,
        /// The check word computed from the bytes.
        expected: u32,
        /// The check word in the packet.
        found: u32,
    },
    /// The status bits of an answer name check type 1 or 2, which are undefined.
    CheckType {
        /// The value of the two bits: 1 or 2.
        bits: u8,
    },
}

impl fmt::Display for PacketError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length { expected, found } => write!(f, "a packet has {expected} bytes, these are {found}"),
            Self::StartWord { found } => write!(f, "the start word is 0x{found:08X}, not 0x{START_WORD:08X}"),
            Self::EndWord { found } => write!(f, "the end word is 0x{found:08X}, not 0x{END_WORD:08X}"),
            Self::CheckWord { kind: CheckType::Fixed, expected, found } => {
                write!(f, "the check word is 0x{found:08X}, the fixed one is 0x{expected:08X}")
            }
            Self::CheckWord { kind: CheckType::Crc32, expected, found } => {
                write!(f, "the check word is 0x{found:08X}, the CRC-32 of the packet is 0x{expected:08X}")
            }
            Self::CheckType { bits } => write!(f, "the status names check type {bits}: none of 0 fixed, 3 CRC-32"),
        }
    }
}

impl core::error::Error for PacketError {}

/// Why a packet cannot be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WriteError {
    /// The buffer is too short for a packet.
    Buffer {
        /// The length of a packet, n + 32.
        needed: usize,
        /// The length of the buffer in bytes.
        found: usize,
    },
    /// The request or the answer does not fit into the data segment, or exceeds another limit of the chip.
    Malformed(Malformed),
}

impl fmt::Display for WriteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Buffer { needed, found } => write!(f, "a packet has {needed} bytes, the buffer has {found}"),
            Self::Malformed(malformed) => malformed.fmt(f),
        }
    }
}

impl core::error::Error for WriteError {}

impl From<Malformed> for WriteError {
    fn from(malformed: Malformed) -> Self {
        Self::Malformed(malformed)
    }
}

/// Builds the command packet of `request` at the beginning of `buffer` and returns its n + 32 bytes, all of which are
/// written.
///
/// The index, the control byte, the interrupt flags to clear and the GPIO outputs are taken from `header`. Code,
/// parameter, information bytes and length come from the request. The reserve bits are those of `header` and of the
/// request together.
///
/// # Errors
/// The buffer is too short, or the request does not fit into n bytes.
pub fn write_request<'b>(
    buffer: &'b mut [u8],
    size: DataSize,
    rule: CheckRule,
    header: CommandHeader,
    request: &impl Encode,
) -> Result<&'b [u8], WriteError> {
    let parts = Parts::of_buffer(buffer, size)?;
    parts.data.fill(0);
    let (code, arguments) = request.command(parts.data)?;
    let packet = &mut buffer[..size.packet_len()];
    Ok(close_request(packet, size, rule, header, code, arguments))
}

/// Builds the command packet around data that `buffer` already holds at the position of the data segment; `arguments`
/// gives their length. The rest of the segment is set to 0.
///
/// # Errors
/// The buffer is too short, or the data do not fit into n bytes.
#[inline]
pub(crate) fn write_around(
    buffer: &mut [u8],
    size: DataSize,
    rule: CheckRule,
    header: CommandHeader,
    code: CommandCode,
    arguments: Arguments,
) -> Result<&[u8], WriteError> {
    let parts = Parts::of_buffer(buffer, size)?;
    let len = Malformed::at_most("valid data length", arguments.len.into(), parts.data.len())?;
    parts.data[len..].fill(0);
    let packet = &mut buffer[..size.packet_len()];
    Ok(close_request(packet, size, rule, header, code, arguments))
}

/// Writes the header, the check word and the end word of a command packet around its data.
#[inline]
fn close_request(
    packet: &mut [u8],
    size: DataSize,
    rule: CheckRule,
    header: CommandHeader,
    code: CommandCode,
    arguments: Arguments,
) -> &[u8] {
    let Arguments { parameter, info, reserve, len } = arguments;
    let header = CommandHeader { code, parameter, info, len, reserve: header.reserve | reserve, ..header };
    packet[..HEADER_LEN].copy_from_slice(&header.encode());
    let word = rule.of_command(&header).word(&packet[..HEADER_LEN + size.bytes()], header.len);
    close(packet, word)
}

/// Builds the answer packet with `answer` at the beginning of `buffer` and returns its n + 32 bytes, all of which are
/// written.
///
/// `header` supplies everything except the return byte and the length, which come from the answer, and the check type
/// in the status, which comes from `rule`. An answer without a result is `()`; set [`Status::NOP`] if it answers no
/// command.
///
/// # Errors
/// The buffer is too short, or the answer does not fit into n bytes.
pub fn write_answer<'b, 'a>(
    buffer: &'b mut [u8],
    size: DataSize,
    rule: CheckRule,
    header: AnswerHeader,
    answer: &impl Answer<'a>,
) -> Result<&'b [u8], WriteError> {
    let parts = Parts::of_buffer(buffer, size)?;
    parts.data.fill(0);
    let Returned { ret, len } = answer.encode(parts.data)?;
    let header = AnswerHeader { ret, len, status: header.status.with_check_type(rule.kind), ..header };
    parts.head.copy_from_slice(&header.encode());
    let packet = &mut buffer[..size.packet_len()];
    let word = rule.word(&packet[..HEADER_LEN + size.bytes()], header.len);
    Ok(close(packet, word))
}

/// Builds an answer packet that reports "not ready": no data, and [`NOT_READY`] as the check word (OBS).
///
/// # Errors
/// The buffer is too short.
pub fn write_not_ready(buffer: &mut [u8], size: DataSize, header: AnswerHeader) -> Result<&[u8], WriteError> {
    let parts = Parts::of_buffer(buffer, size)?;
    parts.data.fill(0);
    parts.head.copy_from_slice(&header.encode());
    Ok(close(&mut buffer[..size.packet_len()], NOT_READY))
}

/// The parts of a packet buffer that are written before the check word.
struct Parts<'b> {
    head: &'b mut [u8],
    data: &'b mut [u8],
}

impl<'b> Parts<'b> {
    /// Splits the beginning of `buffer` into the parts of a packet.
    fn of_buffer(buffer: &'b mut [u8], size: DataSize) -> Result<Self, WriteError> {
        let (needed, found) = (size.packet_len(), buffer.len());
        let Some(packet) = buffer.get_mut(..needed) else { return Err(WriteError::Buffer { needed, found }) };
        let (head, rest) = packet.split_at_mut(HEADER_LEN);
        let (data, _) = rest.split_at_mut(size.bytes());
        Ok(Self { head, data })
    }
}

/// Writes the check word and the end word.
fn close(packet: &mut [u8], word: u32) -> &[u8] {
    let end = packet.len();
    packet[end - 8..end - 4].copy_from_slice(&word.to_le_bytes());
    packet[end - 4..].copy_from_slice(&END_WORD.to_le_bytes());
    packet
}

/// A packet with valid length, start word and end word.
struct Framed<'p> {
    head: &'p [u8; HEADER_LEN],
    /// The header and the data segment, which a CRC-32 may cover.
    covered: &'p [u8],
    data: &'p [u8],
    check_word: u32,
}

impl<'p> Framed<'p> {
    fn parse(bytes: &'p [u8], size: DataSize) -> Result<Self, PacketError> {
        let length = PacketError::Length { expected: size.packet_len(), found: bytes.len() };
        if bytes.len() != size.packet_len() {
            return Err(length);
        }
        let (head, rest) = bytes.split_first_chunk::<HEADER_LEN>().ok_or(length)?;
        let (rest, end_word) = rest.split_last_chunk::<4>().ok_or(length)?;
        let (data, check_word) = rest.split_last_chunk::<4>().ok_or(length)?;
        let start_word = u32::from_le_bytes([head[0], head[1], head[2], head[3]]);
        if start_word != START_WORD {
            return Err(PacketError::StartWord { found: start_word });
        }
        let end_word = u32::from_le_bytes(*end_word);
        if end_word != END_WORD {
            return Err(PacketError::EndWord { found: end_word });
        }
        let covered = &bytes[..HEADER_LEN + data.len()];
        Ok(Self { head, covered, data, check_word: u32::from_le_bytes(*check_word) })
    }

    /// Checks the check word, which also shows whether the packet is an answer or "not ready".
    fn classify(&self, coverage: CrcCoverage) -> Result<PacketKind, PacketError> {
        let (status, len) = AnswerHeader::status_and_len(self.head);
        let found = self.check_word;
        match check_answer(status, len, self.covered, found, coverage) {
            CheckResult::Right => Ok(PacketKind::Answer),
            CheckResult::NotReady => Ok(PacketKind::NotReady),
            CheckResult::Wrong { kind, expected } => Err(PacketError::CheckWord { kind, expected, found }),
            CheckResult::Undefined(bits) => Err(PacketError::CheckType { bits }),
        }
    }
}

/// The kind of an undamaged packet from the chip, like [`Received`] but without the packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PacketKind {
    Answer,
    NotReady,
}

/// A command packet that a chip has received, with a valid check word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandPacket<'p> {
    /// The header of the command, with the command code and its arguments.
    pub header: CommandHeader,
    /// The whole data segment, n bytes.
    pub data: &'p [u8],
}

impl<'p> CommandPacket<'p> {
    /// Parses `bytes`, which must have the length of a packet. The check word must match `rule`; in SPI_RECONFIG_OP it
    /// is always the fixed one.
    ///
    /// # Errors
    /// Length, start word, end word or check word are wrong.
    pub fn parse(bytes: &'p [u8], size: DataSize, rule: CheckRule) -> Result<Self, PacketError> {
        let framed = Framed::parse(bytes, size)?;
        let header = CommandHeader::decode(framed.head).1;
        let rule = rule.of_command(&header);
        let expected = rule.word(framed.covered, header.len);
        if framed.check_word != expected {
            return Err(PacketError::CheckWord { kind: rule.kind, expected, found: framed.check_word });
        }
        Ok(Self { header, data: framed.data })
    }

    /// Decodes the request in the packet. A code or function that is not in the manuals becomes [`Request::Unknown`].
    ///
    /// # Errors
    /// A field of the request has a value that the manuals do not allow.
    pub fn request(&self) -> Result<Request<'p>, Malformed> {
        Request::decode(self.header.code, &self.header.arguments(), self.data)
    }
}

impl CommandHeader {
    /// The arguments of the request in this header: parameter, information bytes, reserve bits and length.
    pub const fn arguments(&self) -> Arguments {
        Arguments { parameter: self.parameter, info: self.info, reserve: self.reserve, len: self.len }
    }
}

/// A valid packet that a host received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received<'p> {
    /// An answer to a command, or an answer with the NOP flag, which has no result.
    Answer(AnswerPacket<'p>),
    /// The chip was not ready for the exchange. This is no error: the host tries again and leaves the chip more idle
    /// time.
    NotReady,
}

/// An answer packet that a host has received, with a valid check word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnswerPacket<'p> {
    /// The header of the answer, with the index and code of the answered command.
    pub header: AnswerHeader,
    /// The whole data segment, n bytes.
    pub data: &'p [u8],
}

impl<'p> AnswerPacket<'p> {
    /// Parses `bytes`, which must have the length of a packet. The packet's own status says whether its check word is
    /// the fixed one or a CRC-32; `coverage` says which bytes a CRC-32 covers.
    ///
    /// # Errors
    /// Length, start word, end word or check word are wrong, or the status names an undefined check type.
    pub fn parse(bytes: &'p [u8], size: DataSize, coverage: CrcCoverage) -> Result<Received<'p>, PacketError> {
        let framed = Framed::parse(bytes, size)?;
        Ok(match framed.classify(coverage)? {
            PacketKind::Answer => {
                Received::Answer(Self { header: AnswerHeader::decode(framed.head).1, data: framed.data })
            }
            PacketKind::NotReady => Received::NotReady,
        })
    }

    /// The result of [`Self::parse`], without the packet.
    pub(super) fn classify(bytes: &[u8], size: DataSize, coverage: CrcCoverage) -> Result<PacketKind, PacketError> {
        Framed::parse(bytes, size)?.classify(coverage)
    }

    /// The packet's result for `call`. The host itself has to compare the index.
    ///
    /// ```
    /// use ecmsk::xf::request::{StateGet, Slaves};
    /// use ecmsk::xf::{
    ///     AnswerHeader, AnswerPacket, CheckRule, CommandCode, CrcCoverage, DataSize, EtherCatState, MAX_PACKET,
    ///     NetworkState, Received, write_answer,
    /// };
    ///
    /// let size = DataSize::MANUAL;
    /// let mut buffer = [0; MAX_PACKET];
    /// let header = AnswerHeader { index: 4, code: CommandCode::StateGet, ..AnswerHeader::default() };
    /// let op = NetworkState::from(EtherCatState::Op);
    /// let bytes = write_answer(&mut buffer, size, CheckRule::CRC32, header, &op)?;
    ///
    /// match AnswerPacket::parse(bytes, size, CrcCoverage::All)? {
    ///     Received::Answer(packet) => assert_eq!(packet.answer_to(&StateGet { slaves: Slaves::All })?, op),
    ///     Received::NotReady => println!("once more, after some idle time"),
    /// }
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// The packet answers another command or none, or its fields have values that the manuals do not allow.
    pub fn answer_to<'d, C: Call<'d>>(&self, call: &C) -> Result<C::Answer<'p>, AnswerError> {
        let AnswerHeader { code, status, ret, len, .. } = self.header;
        if status.contains(Status::NOP) {
            return Err(AnswerError::Nop { index: self.header.index });
        }
        if code != C::CODE {
            return Err(AnswerError::OtherCommand { expected: C::CODE, found: code });
        }
        call.answer(Returned { ret, len }, self.data).map_err(AnswerError::Malformed)
    }
}

/// Why an answer packet has no result for a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnswerError {
    /// The packet has the NOP flag: it contains no result, even if index and code are those of the command (OBS).
    Nop {
        /// The index in the packet's header.
        index: u8,
    },
    /// The packet answers another command.
    OtherCommand {
        /// The command whose answer was expected.
        expected: CommandCode,
        /// The command that the packet answers.
        found: CommandCode,
    },
    /// A field of the answer has a value that the manuals do not allow.
    Malformed(Malformed),
}

impl fmt::Display for AnswerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nop { index } => write!(f, "the packet with index {index} has the NOP flag and no result"),
            Self::OtherCommand { expected, found } => write!(f, "the packet answers {found}, not {expected}"),
            Self::Malformed(malformed) => malformed.fmt(f),
        }
    }
}

impl core::error::Error for AnswerError {}
