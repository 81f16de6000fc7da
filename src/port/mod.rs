//! Servers that make a board reachable for other processes and machines. A server works with any
//! [`Link`](crate::link::Link): a simulated board, a real one, or one that is itself served elsewhere; the server of a
//! chip works with any [`ChipLink`](crate::link::chip_link::ChipLink).
//!
//! - `tcp`: the server for links `tcp://host:port`
//! - `usb_board`: the virtual board as a USB device, without I/O
//! - `usbip`: a virtual board on the USB bus of any machine
//! - `gadget`: a virtual board at a USB device port of this machine (Linux)
//! - `spi`: a virtual board on SPI
//! - `xf`: a chip ECM-XF for other host software, as a stream of bytes
//! - `ethercat`: simulated slaves on a network interface, for any EtherCAT master (Linux)
//! - `log_limit`: limits repeated lines in the log
//! - `passing_frames`: the state of the network, from the frames and reports that pass
//! - `listen`: advice when a server cannot listen on its address
//! - `serving`: the thread of a server that needs only one
//! - `standstill`: stopping the axes of a client or host that has vanished

#[cfg(all(feature = "sim", target_os = "linux"))]
pub mod ethercat;
#[cfg(target_os = "linux")]
pub mod gadget;
mod listen;
mod log_limit;
mod passing_frames;
mod serving;
pub mod spi;
mod standstill;
pub mod tcp;
pub mod usb_board;
pub mod usbip;
pub mod xf;

/// Whether an error of the link is temporary, so that the call may succeed when it is repeated.
const fn is_temporary(error: &crate::link::LinkError) -> bool {
    use crate::link::LinkError;
    matches!(error, LinkError::Timeout { .. } | LinkError::Cancelled { .. } | LinkError::Silent { .. })
}
