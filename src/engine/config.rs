//! The configuration of a board: its pins, its firmware and its timeouts.

use super::{Firmware, PartialFrames};
use crate::fieldbus::Ns;
use crate::sk::SlotSize;

/// The configuration of a board at power-on: its pins, its firmware and its timeouts. Settings that programs send
/// (SET_AXIS, DRIVE_MODE, SET_DC) are not part of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EngineConfig {
    /// Pin CONFIG2: the size of a slot.
    pub slot: SlotSize,
    /// The modelled firmware version.
    pub firmware: Firmware,
    /// Pin CONFIG1 is high: test mode (SK-4). The board goes to OP by itself and switches the outputs of all IO slaves on
    /// and off in turn.
    pub test: bool,
    /// Pin CONFIG3: what happens to command frames that do not arrive completely.
    pub partial_frames: PartialFrames,
    /// How long a change of state may take until it has failed. SK-4 \[OURS]: 10 s.
    pub state_timeout_ns: Ns,
    /// How long a slave may take to answer an SDO. SK-6 \[OURS]: 1 s.
    pub sdo_timeout_ns: Ns,
}

impl Default for EngineConfig {
    fn default() -> Self {
        Self {
            slot: SlotSize::Bytes12,
            firmware: Firmware::V17,
            test: false,
            partial_frames: PartialFrames::Dropped,
            state_timeout_ns: 10_000_000_000,
            sdo_timeout_ns: 1_000_000_000,
        }
    }
}
