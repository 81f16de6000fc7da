//! The virtual board: an ECM-SK on the USB bus of any machine, over USB/IP, whatever is behind its link.
//!
//! [`Server`] listens as `usbipd` does; `usbip attach` of Linux and usbip-win2 on Windows take a board from it. What the
//! host's USB stack then sees is a [`Device`](device::Device).

mod attach;
mod board;
pub mod descriptors;
pub mod device;
mod here;
mod server;
mod session;
pub mod setup;
mod stream;
pub mod wire;

pub use attach::{AttachError, VHCI, free_ports};
pub use board::{Event, Listener, Opener};
pub use descriptors::{Identity, IdentityError};
pub use server::{BoardSpec, Options, ServeError, Server};
pub use session::End;
