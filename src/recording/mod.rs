//! Recordings: reading them, and what their frames tell beside their bytes.
//!
//! [`Recording`] reads a file that a link has written ([`crate::link::record`]), and captures of a real board that
//! Wireshark or tcpdump made by usbmon on Linux or by USBPcap on Windows. Its parts, from the file to the frame:
//!
//! - `formats/`: the formats of files, one file each. A further one goes there.
//! - `meta.rs`: what a recording of ours says of itself in its header.
//! - `devices.rs`: the USB devices of a capture, and which of them is the board; `address.rs`: where one is.
//! - `held.rs`: frames that wait until the capture shows whether the board has taken them.
//! - `reader.rs`: the frames one after the other, as `recorded.rs` has them; `error.rs`: why there is none; `lacks.rs`, `ending.rs`:
//!   what is known to be missing.
//!
//! A recording of a chip ECM-XF holds the bytes of exchanges: `exchanges.rs`.
//!
//! The others look at one frame after the other and keep little, so that a recording may be as long as it likes. The frames
//! need not come from a file:
//!
//! - `order.rs`, `timeline.rs`: the order of frames in time, and their times.
//! - `size.rs`, `kinds.rs`: the slot size, and what the slaves are.
//! - `executed.rs`: which commands the board has executed.

mod address;
mod devices;
mod ending;
mod error;
pub mod exchanges;
mod executed;
pub(crate) mod formats;
mod held;
mod kinds;
mod lacks;
pub(crate) mod meta;
mod order;
mod reader;
mod recorded;
mod size;
mod timeline;

pub use address::{Address, AddressError};
pub use devices::{Seen, Skipped};
pub use ending::lacks_at_end;
pub use error::RecordError;
pub use executed::{Executed, LastExecuted};
pub use kinds::Kinds;
pub use lacks::Lacks;
pub use meta::{Clock, RecordMeta};
pub use order::InOrder;
pub use reader::{Recording, board_in};
pub use recorded::Recorded;
pub use size::{SizeFinder, SizeFrom};
pub use timeline::{Jumps, LONGEST_SILENCE_NS, Timeline};
