//! How the bus uses its chip.

use super::LocalPins;

/// How an [`XfBus`](super::XfBus) uses its chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct XfBusOptions {
    /// How many sets of outputs lie in the chip for a host that is late, 1 to 60: one that is late by as many cycles stops
    /// nothing. As many more as the transport takes are handed over besides
    /// ([`CyclePlan::transport_sets`](super::plan::CyclePlan::transport_sets), 3 to 6 with cycles of 1 ms), all together no more
    /// than the chip's FIFO holds. What lies there was computed so many cycles ago.
    pub ahead: u16,
    /// The clock of SPI in Hz, by which the cycle is judged that can be held; `None`: the link has none.
    pub clock_hz: Option<u32>,
    /// Which pins of the chip are the board's local inputs and outputs.
    pub local_pins: LocalPins,
    /// The wires' clock passes by itself, and not only in exchanges and waits.
    pub real_time: bool,
    /// The chip's packets have one size alone, as those of an ECM-XFU; else the chip is set to another one where the
    /// process data or the cycle need it.
    pub size_is_fixed: bool,
}

impl XfBusOptions {
    /// The most: the chip's FIFO has 64 entries (XF EN 1262), and the transport takes some.
    pub const AHEAD_MAX: u16 = 60;
    /// 4 sets. \[OURS]
    pub const DEFAULT: Self =
        Self { ahead: 4, clock_hz: None, local_pins: LocalPins::NONE, real_time: false, size_is_fixed: false };
}

impl Default for XfBusOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}
