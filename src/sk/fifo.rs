//! The board's command FIFO as the protocol shows it: its depth, and the actions of SET_FIFO (SK-5). The FIFO of the
//! board's model is in `engine/fifo.rs`. Texts and tests write the depth as 160, as the guide does.

/// The depth of the board's command FIFO in OP, in entries (SK-5). An entry is one command frame and lasts one cycle.
pub const FIFO_ENTRIES: u16 = 160;

/// The actions of SET_FIFO on the command FIFO (UG17 2.1.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FifoAction {
    /// 1: drop all entries and cancel a threshold.
    Clear,
    /// 2: set a threshold of 1 or more. The board executes no entry until fewer than this many entries are free, so
    /// that the FIFO is filled before motion begins.
    Threshold(u32),
}
