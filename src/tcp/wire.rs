//! The bytes of the messages between a server and its clients. Both ends use this one definition.
//!
//! A server begins with a [`Greeting`], which is never encrypted. Then messages follow in both directions, in a TLS
//! session if the greeting announces one. A message has the length of its payload (`u16`), its kind (`u8`), a zero
//! byte, and the payload; all numbers are little-endian. The client's first message is [`Message::Hello`], the server's
//! is [`Message::Welcome`] or [`Message::Refused`]. The client numbers its requests; the server answers each of them
//! once and in their order. A client has at most one request in progress.

use super::counts::{get_counters, put_counters};
use super::fields::{Get, Put};
pub use super::message::{Counts, End, Failure, Hello, Message, Refusal, Role, StopEnd, Welcome};
pub use super::wire_error::{PAYLOAD_MAX, VERSION, WireError};
use crate::link::{ReadMeta, Stamp};
use crate::sk::SlotSize;

/// The first bytes of a greeting, by which a client recognises a server.
const MAGIC: [u8; 8] = *b"ecmsktcp";
/// The length of a greeting in bytes.
pub const GREETING_LEN: usize = 16;
/// The length of a message's header, before the payload, in bytes.
pub const HEADER_LEN: usize = 4;
/// The longest text and the longest part of a file in a message, bytes; longer ones are cut.
pub use super::fields::{PART_MAX, TEXT_MAX};
/// The longest message in bytes.
pub const MESSAGE_MAX: usize = HEADER_LEN + PAYLOAD_MAX;

/// The greeting: the first bytes that a server sends on a new connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Greeting {
    /// Whether a TLS session begins after the greeting.
    pub tls: bool,
    /// Whether the server accepts the connection; otherwise the server closes the connection after the greeting.
    pub has_room: bool,
}

impl Greeting {
    /// Encodes the greeting.
    pub fn encode(self) -> [u8; GREETING_LEN] {
        let mut bytes = [0; GREETING_LEN];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..10].copy_from_slice(&VERSION.to_le_bytes());
        bytes[10] = self.tls.into();
        bytes[11] = self.has_room.into();
        bytes
    }

    /// Decodes a greeting.
    ///
    /// # Errors
    /// [`WireError::NoServer`] if the bytes are not a greeting; [`WireError::Version`] if the server has another version of the
    /// protocol.
    pub fn decode(bytes: &[u8; GREETING_LEN]) -> Result<Self, WireError> {
        if bytes[..8] != MAGIC {
            return Err(WireError::NoServer);
        }
        let found = u16::from_le_bytes([bytes[8], bytes[9]]);
        if found != VERSION {
            return Err(WireError::Version { found });
        }
        match bytes[10..] {
            [tls @ 0..=1, room @ 0..=1, 0, 0, 0, 0] => Ok(Self { tls: tls == 1, has_room: room == 1 }),
            _ => Err(WireError::NoServer),
        }
    }
}

const HELLO: u8 = 0x01;
const WRITE: u8 = 0x02;
const READ: u8 = 0x03;
const PASS: u8 = 0x04;
const COUNT: u8 = 0x05;
const CANCEL: u8 = 0x06;
const STOP: u8 = 0x07;
const ASK: u8 = 0x08;
const PING: u8 = 0x40;
const BYE: u8 = 0x41;
const WELCOME: u8 = 0x81;
const REFUSED: u8 = 0x82;
const REPORT: u8 = 0x83;
const WRITTEN: u8 = 0x84;
const GOT: u8 = 0x85;
const PASSED: u8 = 0x86;
const COUNTED: u8 = 0x87;
const FAILED: u8 = 0x88;
const STOPPED: u8 = 0x89;
const MACHINE: u8 = 0x8A;

impl<'a> Message<'a> {
    /// The code of the message's kind in the header.
    pub const fn kind(&self) -> u8 {
        match self {
            Self::Hello(_) => HELLO,
            Self::Write { .. } => WRITE,
            Self::Read { .. } => READ,
            Self::Pass { .. } => PASS,
            Self::Count { .. } => COUNT,
            Self::Cancel { .. } => CANCEL,
            Self::Stop { .. } => STOP,
            Self::Ask { .. } => ASK,
            Self::Ping => PING,
            Self::Bye { .. } => BYE,
            Self::Welcome(_) => WELCOME,
            Self::Refused { .. } => REFUSED,
            Self::Report { .. } => REPORT,
            Self::Written { .. } => WRITTEN,
            Self::Got { .. } => GOT,
            Self::Passed { .. } => PASSED,
            Self::Counted { .. } => COUNTED,
            Self::Failed { .. } => FAILED,
            Self::Stopped { .. } => STOPPED,
            Self::Machine { .. } => MACHINE,
        }
    }

    /// Writes header and payload; returns the length in bytes. A text that is too long is cut.
    pub fn encode(&self, bytes: &mut [u8; MESSAGE_MAX]) -> usize {
        let mut put = Put::new(bytes, HEADER_LEN);
        self.put(&mut put);
        let end = put.at;
        bytes[..2].copy_from_slice(&((end - HEADER_LEN) as u16).to_le_bytes());
        bytes[2..HEADER_LEN].copy_from_slice(&[self.kind(), 0]);
        end
    }

    fn put(&self, put: &mut Put<'_>) {
        match *self {
            Self::Hello(hello) => {
                put.u8(hello.role as u8);
                put.u32(hello.keepalive_ms);
                put.u32(hello.pid);
                put.bytes(hello.proof);
                put.text(hello.program);
            }
            Self::Write { request, wait, frame } => {
                put.u64(request);
                put.wait(wait);
                put.bytes(frame);
            }
            Self::Read { request, wait } => {
                put.u64(request);
                put.wait(wait);
            }
            Self::Pass { request, ns } => {
                put.u64(request);
                put.u64(ns);
            }
            Self::Count { request } | Self::Cancel { request } => put.u64(request),
            Self::Stop { request, off } => {
                put.u64(request);
                put.u8(off.into());
            }
            Self::Ask { request, from } => {
                put.u64(request);
                put.u32(from);
            }
            Self::Ping => {}
            Self::Bye { end, text } => {
                put.u8(end as u8);
                put.text(text);
            }
            Self::Welcome(welcome) => {
                put.bytes(welcome.proof);
                put.u8(welcome.slot.map_or(0, |slot| slot.bytes() as u8));
                put.u8(welcome.virtual_time.into());
                put.u64(welcome.now.0);
                put.u64(welcome.sequence);
                put.text(welcome.board);
                put.text(welcome.slaves);
                put.text(welcome.counts_per_unit);
            }
            Self::Refused { why, text } => {
                put.u8(why as u8);
                put.text(text);
            }
            Self::Report { meta, frame } => {
                put_meta(put, meta);
                put.bytes(frame);
            }
            Self::Written { request, at, now } => {
                put.u64(request);
                put.u64(at.0);
                put.stamp(now);
            }
            Self::Got { request, now, meta, frame } => {
                put.u64(request);
                put.stamp(now);
                put_meta(put, meta);
                put.bytes(frame);
            }
            Self::Passed { request, now } => {
                put.u64(request);
                put.stamp(now);
            }
            Self::Counted { request, counts } => {
                put.u64(request);
                put.u64(counts.reports_dropped);
                put.u8(counts.board.is_some().into());
                counts.board.into_iter().for_each(|board| put_counters(put, board));
            }
            Self::Failed { request, now, failure } => {
                put.u64(request);
                put.stamp(now);
                put.u8(failure.code);
                failure.numbers.iter().for_each(|number| put.u64(*number));
                put.text(failure.text);
            }
            Self::Stopped { request, end, writer, text } => {
                put.u64(request);
                put.u8(end as u8);
                put.text(writer);
                put.text(text);
            }
            Self::Machine { request, length, name, part } => {
                put.u64(request);
                put.u32(length);
                put.text(name);
                put.part(part);
            }
        }
    }

    /// Decodes the message of that kind with that payload.
    ///
    /// # Errors
    /// [`WireError`] if the kind is unknown, the payload has another length than its fields, or a field has an invalid value.
    pub fn decode(kind: u8, payload: &'a [u8]) -> Result<Self, WireError> {
        let mut get = Get::new(kind, payload);
        let message = Self::get(kind, &mut get)?;
        get.end()?;
        Ok(message)
    }

    fn get(kind: u8, get: &mut Get<'a>) -> Result<Self, WireError> {
        Ok(match kind {
            HELLO => Self::Hello(Hello {
                role: match get.u8()? {
                    0 => Role::Writer,
                    1 => Role::Reader,
                    2 => Role::Stopper,
                    3 => Role::Asker,
                    found => return Err(get.value("a role", found.into())),
                },
                keepalive_ms: get.u32()?,
                pid: get.u32()?,
                proof: get.array()?,
                program: get.text()?,
            }),
            WRITE => Self::Write { request: get.u64()?, wait: get.wait()?, frame: get.array()? },
            READ => Self::Read { request: get.u64()?, wait: get.wait()? },
            PASS => Self::Pass { request: get.u64()?, ns: get.u64()? },
            COUNT => Self::Count { request: get.u64()? },
            CANCEL => Self::Cancel { request: get.u64()? },
            STOP => Self::Stop { request: get.u64()?, off: get.flag()? },
            ASK => Self::Ask { request: get.u64()?, from: get.u32()? },
            PING => Self::Ping,
            BYE => {
                let end = match get.u8()? {
                    1 => End::Closed,
                    2 => End::Stopped,
                    3 => End::Lost,
                    4 => End::Broken,
                    5 => End::Overruled,
                    found => return Err(get.value("the reason of an end", found.into())),
                };
                Self::Bye { end, text: get.text()? }
            }
            WELCOME => Self::Welcome(Welcome {
                proof: get.array()?,
                slot: match get.u8()? {
                    0 => None,
                    found => {
                        Some(SlotSize::from_bytes(found.into()).ok_or_else(|| get.value("a slot size", found.into()))?)
                    }
                },
                virtual_time: get.flag()?,
                now: Stamp(get.u64()?),
                sequence: get.u64()?,
                board: get.text()?,
                slaves: get.text()?,
                counts_per_unit: get.text()?,
            }),
            REFUSED => {
                let why = match get.u8()? {
                    1 => Refusal::HasWriter,
                    2 => Refusal::NoBoard,
                    3 => Refusal::Full,
                    4 => Refusal::WrongSecret,
                    5 => Refusal::NoHello,
                    found => return Err(get.value("the reason of a refusal", found.into())),
                };
                Self::Refused { why, text: get.text()? }
            }
            REPORT => Self::Report { meta: get_meta(get)?, frame: get.array()? },
            WRITTEN => Self::Written { request: get.u64()?, at: Stamp(get.u64()?), now: get.stamp()? },
            GOT => Self::Got { request: get.u64()?, now: get.stamp()?, meta: get_meta(get)?, frame: get.array()? },
            PASSED => Self::Passed { request: get.u64()?, now: get.stamp()? },
            COUNTED => {
                let (request, reports_dropped) = (get.u64()?, get.u64()?);
                let board = if get.flag()? { Some(get_counters(get)?) } else { None };
                Self::Counted { request, counts: Counts { reports_dropped, board } }
            }
            FAILED => Self::Failed {
                request: get.u64()?,
                now: get.stamp()?,
                failure: Failure { code: get.u8()?, numbers: [get.u64()?, get.u64()?], text: get.text()? },
            },
            STOPPED => Self::Stopped {
                request: get.u64()?,
                end: match get.u8()? {
                    1 => StopEnd::Stand,
                    2 => StopEnd::NotInOp,
                    3 => StopEnd::Unknown,
                    4 => StopEnd::Failed,
                    found => return Err(get.value("the end of a stop", found.into())),
                },
                writer: get.text()?,
                text: get.text()?,
            },
            MACHINE => Self::Machine { request: get.u64()?, length: get.u32()?, name: get.text()?, part: get.part()? },
            kind => return Err(WireError::Kind { kind }),
        })
    }
}

fn put_meta(put: &mut Put<'_>, meta: ReadMeta) {
    put.u64(meta.at.0);
    put.u64(meta.sequence);
    put.u64(meta.dropped);
}

fn get_meta(get: &mut Get<'_>) -> Result<ReadMeta, WireError> {
    Ok(ReadMeta { at: Stamp(get.u64()?), sequence: get.u64()?, dropped: get.u64()? })
}
