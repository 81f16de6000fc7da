//! The board's command FIFO, as the protocol shows it: its depth, and what SET_FIFO does to it (SK-5). The model of the
//! board has the FIFO itself, in `engine/fifo.rs`. Texts and tests say 160 as the guide does.

/// The depth of the board's command FIFO in OP, in entries (SK-5). An entry is one command frame and lasts one cycle.
pub const FIFO_ENTRIES: u16 = 160;

/// What SET_FIFO does to the command FIFO (UG17 2.1.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FifoAction {
    /// 1: drop all entries and cancel a threshold.
    Clear,
    /// 2: execute no entry until fewer than this many entries are free, so that the FIFO is filled before motion begins.
    /// Not 0.
    Threshold(u32),
}
