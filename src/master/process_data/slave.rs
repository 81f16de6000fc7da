//! The process data of one slave: its sync managers, where its data lie, and what its registers say about both.

use std::ops::Range;
use std::sync::Arc;

use super::SEGMENT_STEP;
use crate::ethercat::registers::{Fmmu, FmmuDirections, SyncManager};
use crate::master::{SlaveInfo, SyncSignals};

/// Where process data of one direction lie.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    /// The number of the datagram.
    pub(super) segment: usize,
    pub(super) range: Range<usize>,
}

/// What the registers of a slave say about its process data.
#[derive(Debug, Default)]
pub(in crate::master) struct Registers {
    /// The sync managers, with their numbers.
    pub(in crate::master) managers: Vec<(u8, SyncManager)>,
    /// The FMMUs that map them.
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
    /// What follows from all that, for changes of state.
    pub(super) registers: Arc<Registers>,
}

impl SlaveData {
    /// Those of a slave that has none yet, with room for what its EEPROM describes.
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

    /// Its process data, or where they lie, are others.
    pub(super) fn update_registers(&mut self) {
        if Arc::get_mut(&mut self.registers).is_none() {
            // A change of state that is under way keeps those that it has begun with.
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

/// How many bytes sync managers have together.
pub(super) fn bytes_of(managers: impl IntoIterator<Item = (u8, SyncManager)>) -> usize {
    managers.into_iter().map(|(_, manager)| usize::from(manager.len)).sum()
}
