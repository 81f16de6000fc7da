//! Servers that make a board reachable for other processes and machines. A server works with any
//! [`Link`](crate::link::Link): a simulated board, a real one, or one that is itself served elsewhere.
//!
//! - `tcp`: the server for links `tcp://host:port`
//! - `usbip`: a virtual board on the USB bus of any machine
//! - `spi`: a virtual board on SPI
//! - `notes`: the queue of log lines of a server

mod listen;
pub mod notes;
pub mod spi;
pub mod tcp;
pub mod usbip;
