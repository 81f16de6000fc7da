//! The virtual board: an ECM-SK on the USB bus of any machine, over USB/IP, for any link.
//!
//! [`Server`] listens as `usbipd` does. `usbip attach` on Linux and usbip-win2 on Windows attach one of its boards, and
//! the USB stack of that host then sees a [`Device`](device::Device).
//!
//! Files, in the order in which to read them:
//!
//! - `server.rs`: [`Server`], its options, and the requests of clients that have no board yet
//! - `board.rs`: a board of the server, and the host that has attached it
//! - `session.rs`, `stream.rs`: a host that has attached a board, and its connection
//! - `device.rs`: the USB device that the host sees, that of `port/usb_board`, with answers as messages
//! - `wire.rs`: the bytes of USB/IP
//! - `attach.rs`, `attach/`, `keep_attached.rs`: boards on this machine's own USB bus (`--attach`)

mod attach;
mod board;
pub mod device;
mod keep_attached;
mod server;
mod session;
mod stream;
pub mod wire;

pub use super::usb_board::{descriptors, setup};
pub use attach::{AttachError, VHCI, free_ports};
pub use board::{Event, Listener, Opener};
pub use descriptors::{Identity, IdentityError};
pub use server::{BoardSpec, Options, ServeError, Server};
pub use session::SessionEnd;
