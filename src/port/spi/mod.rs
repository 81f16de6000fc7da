//! The board's side of SPI: what the board sends on MISO and when BUSY is high, for any link.
//!
//! A [`SpiBoard`] handles whole exchanges. It has no access to hardware: the caller, a test or the software of a test
//! rig, passes the bytes of MOSI and MISO and drives the BUSY line.

mod board;

pub use board::{SpiBoard, SpiBoardCounters};
