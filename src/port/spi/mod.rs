//! The board's side of SPI: what the board sends on MISO and when BUSY is high, for any link.
//!
//! A [`SpiBoard`] handles whole exchanges. The code that has the wires, in a test or in a rig, passes the bytes to it and
//! drives the BUSY line.

mod board;

pub use board::{SpiBoard, SpiBoardCounters};
