//! The board's side of SPI: what answers on MISO and when BUSY is high, whatever is behind its link.
//!
//! A [`Face`] is fed with whole exchanges; whoever has the wires (a test's, those of a rig) moves its bytes and shows its
//! BUSY line.

mod face;

pub use face::{Face, FaceCounters};
