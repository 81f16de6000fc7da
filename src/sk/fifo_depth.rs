//! The depth of the board's command FIFO (SK-5). The FIFO of the board's model is in `engine/fifo.rs`. Tests write 160,
//! the number in the guide, instead of this constant, so that they fail if the constant is wrong.

/// The depth of the board's command FIFO in OP, in entries (SK-5). An entry is one command frame and lasts one cycle.
pub const FIFO_ENTRIES: u16 = 160;
