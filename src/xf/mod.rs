//! The wire format of the ECM-XF: packets, check words, typed requests and answers, and a search for packets in a
//! stream. The module also has the driver for a host and a model of the chip.
//!
//! The ECM-XF is a chip that works as an EtherCAT master and is controlled over SPI; the ECM-XFU is the same with USB.
//! A host sends it one command packet and receives, in the same exchange, one answer packet, which belongs to an
//! earlier command. Both have the same layout: a header of 24 bytes, a data segment of n bytes, a check word and an end
//! word. Apart from `chip` this module has no I/O and no allocation, is `no_std`, and keeps state only in [`resync`]
//! and [`host`]. All byte offsets of the protocol are in this module; the rest of the crate uses its types. Each
//! request and each answer can be encoded and decoded, so that hosts and models of the chip use the same types.
//!
//! To add a command, begin with its row in `command_table.rs`, whose first comment names the other files to change.
//!
//! How to read it:
//!
//! | module | what it holds |
//! | --- | --- |
//! | [`size`] | n, the size of the data segment, which is known at run time only |
//! | [`header`] | the two headers: of a command and of an answer, with the meaning of their bits |
//! | [`check`] | the check word: fixed or CRC-32, and which bytes it covers |
//! | [`packet`] | building packets in a buffer, and parsing them |
//! | [`resync`] | finding packets in a stream of bytes with unknown n and offset |
//! | [`command_table`] | the table of all command codes and functions |
//! | [`value`] | numbers of slaves, motors and pins, limited to their range |
//! | [`request`] | all functions as requests, one type each, and [`Request`] over all |
//! | [`response`] | the results in the chip's answers |
//! | [`fields`] | a table of all functions with the fields of their requests and answers |
//! | `layout` | declarations of the layouts of requests and answers, from which encoding, decoding and fields follow |
//! | [`malformed`] | the error for an invalid field |
//! | [`host`] | the driver of a host: the next exchange, and the interpretation of its answer |
//! | `chip` | with the feature `sim`: a model of the chip, the other end of the wire |
//!
//! Three notations are used throughout:
//! - `XF EN 436`, `XF ZH 442`: the line of the text of NEXTW's *ECM-XF user manual*, English v050 and Chinese v049,
//!   where the command's block begins; `OBS`: seen in the vendor's own driver and in programs that work with real
//!   chips; `[OURS]`: a decision of this project, where no source says anything.
//! - `par`, `i0` to `i3`, `ret`: the parameter byte 0x0D and the information bytes 0x04 to 0x07 of a command, and the
//!   return byte 0x0D of an answer. `@4` is byte 4 of the data segment.
//! - `XF-1.5`: the row of `docs/rules/xf.md` in the project's repository that states the rule and its source.
//!
//! ```
//! use ecmsk::xf::request::{Slaves, StateSet};
//! use ecmsk::xf::{CheckRule, CommandHeader, CommandPacket, DataSize, EtherCatState, MAX_PACKET, write_request};
//!
//! let mut buffer = [0xA5; MAX_PACKET];
//! let request = StateSet { slaves: Slaves::All, state: EtherCatState::Op };
//! let header = CommandHeader::with_index(4);
//! let packet = write_request(&mut buffer, DataSize::MANUAL, CheckRule::CRC32, header, &request)?;
//! assert_eq!(packet.len(), 144);
//! assert_eq!(packet[0x0B..0x0E], [4, 12, 0xFF]);
//!
//! let received = CommandPacket::parse(packet, DataSize::MANUAL, CheckRule::CRC32)?;
//! assert_eq!(received.request()?, request.into());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod check;
mod check_type;
#[cfg(feature = "sim")]
pub mod chip;
pub mod command_table;
pub mod fields;
pub mod header;
pub mod host;
mod layout;
pub mod malformed;
pub mod packet;
pub mod request;
pub mod response;
pub mod resync;
mod segment;
pub mod size;
pub mod value;

pub use check::{CheckRule, CrcCoverage, CrcCoverages};
pub use check_type::CheckType;
pub use command_table::CommandCode;
pub use header::{AnswerHeader, CommandHeader, Control, Errors, Interrupts, NetworkState, Reserve, Status};
pub use malformed::{Allowed, Malformed};
pub use packet::{AnswerPacket, CommandPacket, PacketError, Received, WriteError, write_answer, write_request};
pub use request::{Call, Request};
pub use resync::Resync;
pub use size::DataSize;
pub use value::EtherCatState;

/// The first word of every packet: bytes A4 A3 A2 A1 (XF EN 211, table 1).
pub const START_WORD: u32 = 0xA1A2_A3A4;
/// The last word of every packet: bytes 59 58 57 56 (XF EN 181).
pub const END_WORD: u32 = 0x5657_5859;
/// The check word of check type 0 (XF EN 180).
pub const FIXED_CHECK: u32 = 0x1234_5678;
/// The check word of an answer that means "not ready": the chip needs more idle time (OBS).
pub const NOT_READY: u32 = 0x8765_4321;
/// Size of a header in bytes, both of a command and of an answer.
pub const HEADER_LEN: usize = 24;
/// Size of the check word and the end word after the data segment, in bytes.
pub const TRAILER_LEN: usize = 8;
/// Size of the longest packet in bytes: 1408 of data and 32 around them.
pub const MAX_PACKET: usize = DataSize::MAX.packet_len();
