//! File access over EtherCAT (FoE): mailbox messages that read or write a file in packets.
//!
//! Source: ETG.1000.6 5.8; rules ECAT-6.

use super::WireError;
use super::named_codes::named_codes;
use super::wire_error::{room_for, split};

/// The number of mailbox bytes that a data packet uses for headers: the mailbox header, operation code, reserved byte
/// and packet number. A packet that does not fill the mailbox is the last one of the file.
pub const FOE_OVERHEAD: usize = 6 + FoeMessage::HEADER_LEN;

/// The error code of a failed file transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FoeError(pub u32);

named_codes! {
    FoeError as "0x{:04X}";
    UNDEFINED = 0x8000, "not defined";
    NOT_FOUND = 0x8001, "the file was not found";
    ACCESS_DENIED = 0x8002, "access is denied";
    DISK_FULL = 0x8003, "the disk is full";
    ILLEGAL = 0x8004, "illegal operation";
    PACKET_NUMBER = 0x8005, "wrong packet number";
    ALREADY_EXISTS = 0x8006, "the file exists already";
    NO_USER = 0x8007, "no such user";
    BOOTSTRAP_ONLY = 0x8008, "in bootstrap only";
    NOT_BOOTSTRAP = 0x8009, "not in bootstrap";
    NO_RIGHTS = 0x800A, "no rights";
    PROGRAM_ERROR = 0x800B, "program error";
    WRONG_CHECKSUM = 0x800C, "wrong checksum";
}

/// An FoE message. File names and texts are raw bytes, because the standard does not define their encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FoeMessage<'a> {
    /// 1: read request.
    Read {
        /// The password that the slave expects; 0 if it expects none.
        password: u32,
        /// The name of the file.
        name: &'a [u8],
    },
    /// 2: write request.
    Write {
        /// The password that the slave expects; 0 if it expects none.
        password: u32,
        /// The name of the file.
        name: &'a [u8],
    },
    /// 3: a data packet of the file.
    Data {
        /// Packet number, from 1.
        packet: u32,
        /// File data.
        data: &'a [u8],
    },
    /// 4: acknowledges a packet or a write request.
    Ack {
        /// The number of the acknowledged packet; 0 for the write request.
        packet: u32,
    },
    /// 5: the transfer has failed.
    Error {
        /// The reason as an error code.
        code: FoeError,
        /// The reason as text, possibly empty.
        text: &'a [u8],
    },
    /// 6: the slave is busy and needs more time.
    Busy {
        /// The amount of work that is done, in a unit that the slave chooses.
        done: u16,
        /// The whole amount of work, in the same unit as `done`.
        entire: u16,
        /// A progress text, possibly empty.
        text: &'a [u8],
    },
    /// Any other operation code, with the bytes after the reserved byte.
    Unknown(u8, &'a [u8]),
}

impl<'a> FoeMessage<'a> {
    /// Length in bytes of operation code, reserved byte, and the 32-bit field after them: password, packet number,
    /// error code or progress.
    const HEADER_LEN: usize = 6;

    /// Decodes the data of a mailbox message.
    ///
    /// # Errors
    /// [`WireError::Short`]: the data end before the message does.
    pub fn decode(data: &'a [u8]) -> Result<Self, WireError> {
        let ([operation, _], rest) = split::<2>(data, "FoE operation")?;
        if !matches!(operation, 1..=6) {
            return Ok(Self::Unknown(*operation, rest));
        }
        let (four, rest) = split::<4>(rest, "FoE header")?;
        let number = u32::from_le_bytes(*four);
        Ok(match operation {
            1 => Self::Read { password: number, name: rest },
            2 => Self::Write { password: number, name: rest },
            3 => Self::Data { packet: number, data: rest },
            4 => Self::Ack { packet: number },
            5 => Self::Error { code: FoeError(number), text: rest },
            _ => Self::Busy { done: number as u16, entire: (number >> 16) as u16, text: rest },
        })
    }

    /// Writes the message and returns its length in bytes.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the message does not fit.
    pub fn encode(&self, room: &mut [u8]) -> Result<usize, WireError> {
        let (operation, number, rest): (u8, u32, &[u8]) = match *self {
            Self::Read { password, name } => (1, password, name),
            Self::Write { password, name } => (2, password, name),
            Self::Data { packet, data } => (3, packet, data),
            Self::Ack { packet } => (4, packet, &[]),
            Self::Error { code, text } => (5, code.0, text),
            Self::Busy { done, entire, text } => (6, u32::from(done) | u32::from(entire) << 16, text),
            Self::Unknown(operation, rest) => {
                let len = 2 + rest.len();
                let (header, place) = room_for(room, "FoE message", len)?.split_at_mut(2);
                header.copy_from_slice(&[operation, 0]);
                place.copy_from_slice(rest);
                return Ok(len);
            }
        };
        let len = Self::HEADER_LEN + rest.len();
        let (header, place) = room_for(room, "FoE message", len)?.split_at_mut(Self::HEADER_LEN);
        header[..2].copy_from_slice(&[operation, 0]);
        header[2..].copy_from_slice(&number.to_le_bytes());
        place.copy_from_slice(rest);
        Ok(len)
    }
}
