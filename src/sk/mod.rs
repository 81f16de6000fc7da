//! The wire format of the ECM-SK: slots, frames, CRC-8, typed commands and responses, a readable dump.
//!
//! In each EtherCAT cycle a host sends the board one command frame and receives one response frame. Both have the same
//! layout: slot 0 belongs to the board itself, the slots after it to the slaves in the order of the network, the last
//! slot to SDO transfers. This module has no I/O, no state and no allocation, and is `no_std`. All byte offsets of the
//! protocol are in this module; the rest of the crate uses its types.
//!
//! How to read it:
//!
//! | module | what it holds |
//! | --- | --- |
//! | [`slot`] | a slot as bytes, 12 or 16 of them |
//! | [`frame`] | a frame: the 512 bytes that travel each way |
//! | [`find_size`] | the slot size of a frame, derived from its bytes |
//! | [`crc`] | the CRC-8 in byte 3 of a frame |
//! | [`command_table`] | the ids of the 22 commands, the slots that take each of them, and its effect on a target |
//! | [`argument`] | the arguments of commands as types that hold valid values only |
//! | [`fifo_depth`] | the depth of the command FIFO |
//! | [`command`] | commands with their meaning: for the board, for a slave, for the SDO slot |
//! | [`response`] | responses with their meaning; the state of the network is in `state.rs` |
//! | [`dump`] | a frame as readable lines |
//!
//! Three notations are used throughout:
//! - "40 (30)": the number for slots of 12 bytes and, in brackets, the number for slots of 16 bytes.
//! - `UG17 2.1.3`: the chapter of NEXTW's *ECM-SK User Guide* V1.7.4; `UG15`: the quick start for firmware 1.5; `OBS`:
//!   seen in programs that work with real boards; `[OURS]`: a decision of this project, where no source says anything.
//! - `SK-5.6`: the row of `docs/rules/board.md` in the project's repository that states the rule and its source; a bare
//!   `SK-5` is that section.
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
pub mod command_table;
pub mod crc;
pub mod dump;
pub mod fifo_depth;
pub mod find_size;
pub mod frame;
pub mod response;
pub mod slot;
mod state;

pub use argument::{Argument, AxisTarget, CycleTime, DcShift, DriveSync, FifoAction, InvalidArgument, SlaveKind};
pub use command::{MasterCommand, Motion, SdoCommand, SlaveCommand, SlotCommand};
pub use command_table::{CommandId, SlotKind, TargetEffect};
pub use crc::{CrcError, CrcPolicy, CrcStatus};
pub use dump::{CommandDump, ResponseDump};
pub use fifo_depth::FIFO_ENTRIES;
pub use find_size::SlotForm;
pub use frame::{Dir, FRAME_LEN, Frame};
pub use response::{DriveResponse, HspAxis, HspResponse, IoResponse, MasterResponse, SdoResponse, SlaveResponse};
pub use slot::{RawSlot, SlotSize, Slots};
pub use state::{MasterState, StateByte};

/// The board's vendor and product id on USB (SK-9). Many hobby devices use the same ids.
pub const BOARD_IDS: (u16, u16) = (0x16C0, 0x05DF);
/// Byte 0 of slot 0 of every response in OP: "master cyclic response", whatever the command was (UG17 2.1.1).
pub const MASTER_CYCLIC: u8 = 0xBF;
