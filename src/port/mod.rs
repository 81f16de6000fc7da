//! Ports: what makes a board reachable for other processes and machines. A port serves whatever is behind a
//! [`Link`](crate::link::Link) and knows nothing of it.

mod listen;
pub mod notes;
pub mod spi;
pub mod tcp;
pub mod usbip;
