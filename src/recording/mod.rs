//! Reads recordings, and derives what frames do not state: the slot size, the kinds of slaves, which commands were
//! executed.
//!
//! [`Recording`] reads a file that a link has written ([`crate::link::record`]), and captures of a real board that
//! Wireshark or tcpdump made by usbmon on Linux or by USBPcap on Windows. Its parts, from the file to the frame:
//!
//! - `file_formats/`: the formats of files, one source file each; new formats go there.
//! - `meta.rs`: the metadata in the header of a recording.
//! - `devices.rs`: the USB devices of a capture, and which of them is the board; `address.rs`: its USB address.
//! - `pending.rs`: frames that wait until the capture shows whether the board has taken them.
//! - `reader.rs`: reads the frames, each a [`Recorded`]; `error.rs`: why reading fails; `lacks.rs`, `ending.rs`: what
//!   is missing.
//! - `window.rs`: a stretch of time of a long recording; `outline.rs`: what is in one, by its index.
//! - `exchanges.rs`: reads the recording of an ECM-XF, which has the bytes of exchanges.
//!
//! The other files process one frame after the other with little memory, so a recording may be of any length. They work
//! on frames from any source:
//!
//! - `order.rs`, `timeline.rs`: the order of frames in time, and their times.
//! - `size.rs`, `slave_kinds.rs`: the slot size, and the kinds of the slaves.
//! - `executed.rs`, `execution.rs`: which commands the board has executed; the commands themselves, with their times.
//! - `run_execution.rs`: the same from the frames of a whole run.

mod address;
mod devices;
mod ending;
mod error;
pub mod exchanges;
mod executed;
mod execution;
pub(crate) mod file_formats;
mod lacks;
pub(crate) mod meta;
mod order;
mod outline;
mod pending;
mod reader;
mod recorded;
mod run_execution;
mod size;
mod slave_kinds;
mod timeline;
mod window;

pub use address::{Address, AddressError};
pub use devices::{CapturedDevice, Skipped};
pub use ending::lacks_at_end;
pub use error::RecordError;
pub use executed::{Executed, LastExecuted};
pub use execution::{Entry, Execution, ExecutionReport, Orders};
pub use lacks::{Damage, Lacks, Lost};
pub use meta::{CarriedFile, Clock, RecordMeta};
pub use order::InOrder;
pub use outline::Outline;
pub use reader::{Recording, board_in};
pub use recorded::Recorded;
pub use run_execution::RunExecution;
pub use size::{SizeFinder, SizeFrom};
pub use slave_kinds::Kinds;
pub use timeline::{Jumps, LONGEST_SILENCE_NS, Timeline};
pub use window::WindowOf;
