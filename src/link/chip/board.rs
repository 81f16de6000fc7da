//! The EC01M over the wires to a chip: `xf-sim:` opened as a board.

use super::{ChipLink, ChipOptions, host_config};
use crate::fieldbus::xf::{XfBus, XfBusOptions};

/// The bus of a board over that link, with at most `ahead` sets of outputs in the chip. The bus drives the clock of the
/// wires: a real one sleeps in its calls.
pub(in crate::link) fn bus<L: ChipLink>(link: L, driver: &ChipOptions, ahead: u16) -> XfBus<L> {
    let info = link.info();
    XfBus::new(
        link,
        host_config(&info, driver),
        XfBusOptions { ahead, clock_hz: info.clock_hz, size_is_fixed: info.size.is_some() },
    )
}
