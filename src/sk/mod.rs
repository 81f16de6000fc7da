//! The wire format of the ECM-SK: slots, frames, CRC-8, typed commands and responses, a readable dump.
//!
//! No I/O, no state, no allocation, `no_std`. This room holds the only byte offsets of the protocol:
//! everything else speaks its types. The bytes ([`slot`], [`frame`]) are kept apart from their meaning
//! ([`command`], [`response`]).
//!
//! ```
//! use ecmsk::sk::{Frame, MasterCommand, MasterState, SlotSize};
//!
//! let mut frame = Frame::new();
//! frame.put_master(SlotSize::Bytes12, &MasterCommand::SetState(MasterState::PreOp));
//! frame.fill_crc(SlotSize::Bytes12);
//! assert_eq!(frame.bytes()[..5], [0x01, 0, 0, 0xE7, 0x02]);
//! ```

pub mod argument;
pub mod command;
pub mod crc;
pub mod dump;
pub mod find_size;
pub mod frame;
pub mod id;
pub mod response;
pub mod slot;

pub use argument::{CycleTime, DcShift, DriveSync, FifoAction, Malformed, SlaveKind};
pub use command::{AxisTarget, MasterCommand, Motion, SdoCommand, SlaveCommand, SlotCommand};
pub use crc::{CrcError, CrcPolicy, CrcStatus};
pub use dump::{CommandDump, ResponseDump};
pub use find_size::SlotForm;
pub use frame::{FRAME_LEN, Frame};
pub use id::{CommandId, SlotKind};
pub use response::{
    DriveResponse, HspAxis, HspResponse, IoResponse, MasterResponse, MasterState, SdoResponse, SlaveResponse, StateByte,
};
pub use slot::{RawSlot, SlotSize, Slots};

/// Entries of the command FIFO (SK-5, UG15n: 0xA0).
pub const FIFO_ENTRIES: u16 = 160;
/// Byte 0 of slot 0 whenever the state is OP: "master cyclic response" (UG17 2.1.1).
pub const MASTER_CYCLIC: u8 = 0xBF;
