//! The options of a bus over an ECM-XF.

use super::LocalPins;

/// How an [`XfBus`](super::XfBus) uses its chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct XfBusOptions {
    /// How many sets of outputs the chip holds for a host that is late, 1 to 60: if the host is late by at most this
    /// number of cycles, the chip still has outputs for each cycle. In addition the bus writes as many sets as the
    /// transport takes ([`CyclePlan::transport_sets`](super::plan::CyclePlan::transport_sets), 3 to 6 with cycles of 1
    /// ms), in total at most as many as the chip's FIFO holds. A target is computed that many cycles before the chip
    /// sends it.
    pub ahead: u16,
    /// The SPI clock in Hz. With it the bus computes how long packets take, and whether a cycle time is possible.
    /// `None`: the link has no clock, and packets count as taking no time.
    pub clock_hz: Option<u32>,
    /// Which pins of the chip are the board's local inputs and outputs.
    pub local_pins: LocalPins,
    /// Whether the clock of the wires to the chip advances by itself. Otherwise it advances only in exchanges and
    /// waits.
    pub real_time: bool,
    /// Whether the chip's packets have a fixed size, as those of an ECM-XFU. Otherwise the chip is set to another size
    /// if the process data or the cycle need it.
    pub size_is_fixed: bool,
}

impl XfBusOptions {
    /// The maximum of `ahead`: the chip's FIFO has 64 entries (XF EN 1262), and the transport takes some of them.
    pub const AHEAD_MAX: u16 = 60;
    /// The default: `ahead` is 4 sets of outputs. \[OURS]
    pub const DEFAULT: Self =
        Self { ahead: 4, clock_hz: None, local_pins: LocalPins::NONE, real_time: false, size_is_fixed: false };
}

impl Default for XfBusOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}
