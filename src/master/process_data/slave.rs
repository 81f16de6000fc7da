//! The process data of one slave: its sync managers, the place of its data in a datagram, and the registers for both.

use std::ops::Range;
use std::sync::Arc;

use super::SEGMENT_STEP;
use crate::ethercat::registers::{Fmmu, FmmuDirections, SyncManager};
use crate::master::{SlaveInfo, SyncSignals};

/// Where a slave's process data of one direction are: the segment, and the bytes in it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    /// The index of the segment in `ProcessData::segments`.
    pub(super) segment: usize,
    pub(super) range: Range<usize>,
}

/// The registers of a slave that describe its process data.
#[derive(Debug, Default)]
pub(in crate::master) struct Registers {
    /// The sync managers, each with its number.
    pub(in crate::master) managers: Vec<(u8, SyncManager)>,
    /// The FMMUs that map these sync managers to logical addresses.
    pub(in crate::master) fmmus: Vec<Fmmu>,
}

/// The process data of one slave.
#[derive(Clone, Debug, Default)]
pub(super) struct SlaveData {
    pub(super) outputs: Vec<(u8, SyncManager)>,
    pub(super) inputs: Vec<(u8, SyncManager)>,
    pub(super) lacks_lrw: bool,
    pub(super) sync: Option<SyncSignals>,
    pub(super) output_place: Place,
    pub(super) input_place: Place,
    /// The registers that changes of state write; computed from the fields above.
    pub(super) registers: Arc<Registers>,
}

impl SlaveData {
    /// A slave without process data, with memory for those that its EEPROM describes.
    pub(super) fn of(info: &SlaveInfo) -> Self {
        let (outputs, inputs) = (info.outputs.len(), info.inputs.len());
        let (managers, fmmus) = (Vec::with_capacity(outputs + inputs), Vec::with_capacity(outputs + inputs));
        Self {
            outputs: Vec::with_capacity(outputs),
            inputs: Vec::with_capacity(inputs),
            registers: Arc::new(Registers { managers, fmmus }),
            ..Self::default()
        }
    }

    /// Recomputes the registers after a change of the process data or of their place.
    pub(super) fn update_registers(&mut self) {
        if Arc::get_mut(&mut self.registers).is_none() {
            // A running change of state still refers to the old registers and continues with them.
            self.registers = Arc::default();
        }
        let Some(Registers { managers: all, fmmus }) = Arc::get_mut(&mut self.registers) else { return };
        all.clear();
        all.extend(self.outputs.iter().chain(&self.inputs));
        fmmus.clear();
        for (managers, place, directions) in [
            (&self.outputs, &self.output_place, FmmuDirections::WRITE),
            (&self.inputs, &self.input_place, FmmuDirections::READ),
        ] {
            let mut logical = place.segment as u32 * SEGMENT_STEP + place.range.start as u32;
            for (_, manager) in managers.iter().filter(|(_, manager)| manager.len > 0) {
                fmmus.push(Fmmu::bytes(logical, manager.len, manager.start, directions));
                logical += u32::from(manager.len);
            }
        }
    }
}

/// The sum of the lengths of sync managers, bytes.
pub(super) fn bytes_of(managers: impl IntoIterator<Item = (u8, SyncManager)>) -> usize {
    managers.into_iter().map(|(_, manager)| usize::from(manager.len)).sum()
}
