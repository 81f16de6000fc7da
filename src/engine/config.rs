//! What a board is before a program tells it anything.

use super::{Firmware, PartialFrames};
use crate::fieldbus::Ns;
use crate::sk::SlotSize;

/// The configuration of a board: its pins and its firmware, and not what programs tell it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EngineConfig {
    /// Pin CONFIG2: the size of a slot.
    pub slot: SlotSize,
    /// The firmware that is modelled.
    pub firmware: Firmware,
    /// Pin CONFIG1 is high: test mode (SK-4). The board goes to OP by itself and switches the outputs of all IO slaves on
    /// and off in turn.
    pub test: bool,
    /// Pin CONFIG3: what happens to command frames that do not arrive completely.
    pub partial_frames: PartialFrames,
    /// How long a change of state may take. SK-4 \[OURS]: 10 s.
    pub state_timeout_ns: Ns,
    /// How long a slave may take for an SDO. SK-6 \[OURS]: 1 s.
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
