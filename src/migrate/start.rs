//! The way to OP: how long it was in the recording, and how long it is with the slaves behind a chip.

use super::{Network, Place};
use crate::fieldbus::pdo::ProcessData;
use crate::sk::{DriveSync, MasterState, StateByte};
use crate::xf::host::COMFORTABLE_SIZE;

/// How long a change of state may take on a board, and over a chip if its link says nothing else, in nanoseconds (SK-4.55).
const STATE_TIMEOUT_NS: i64 = 10_000_000_000;
/// `state_timeout_ms=` is this many times as long as the way to OP, in tenths, where that may take longer than a board waits: real
/// slaves may need three times as long as those of the model. \[OURS]
const SPARE_TENTHS: i64 = 30;
/// What the way takes whatever the slaves are: two changes of state of all, the layout of the process data. \[OURS]
const ALL_NS: i64 = 405_000_000;
/// What it takes until the packets have another size, where the process data do not fit into short ones. \[OURS]
const SIZE_NS: i64 = 110_000_000;
/// What a slave takes beside its SDOs: its place in the layout, its part of each change, its states are read. \[OURS]
const SLAVE_NS: i64 = 22_000_000;
/// One SDO of the configuration that writes, or reads an object of the mapping, with the packets that carry it. \[OURS]
const SDO_NS: i64 = 3_800_000;
/// What a slave takes more that goes to OP alone, as all do beside one that is declared none. \[OURS]
const ALONE_NS: i64 = 50_000_000;
/// What a slave takes that is declared none: it comes back from SafeOP. \[OURS]
const NONE_NS: i64 = 35_000_000;

/// The way to OP, on the recorded board and over a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Start {
    /// The longest that it took in the recording from SET_STATE on, in nanoseconds, and the report that showed OP. `None`: OP was
    /// not reached by SET_STATE.
    pub recorded: Option<(i64, Place)>,
    /// How long it takes over a chip, in nanoseconds: [`time_to_op_ns`].
    pub chip_ns: i64,
    /// `state_timeout_ms=` for the links, if a change of state may take longer than by default.
    pub timeout_ms: Option<i64>,
}

impl Start {
    pub(super) fn of(network: &Network, recorded: Option<(i64, Place)>) -> Self {
        let chip_ns = time_to_op_ns(network);
        let spare_ns = chip_ns * SPARE_TENTHS / 10;
        let timeout_ms = (spare_ns > STATE_TIMEOUT_NS).then_some(spare_ns.div_euclid(1_000_000_000) * 1000 + 1000);
        Self { recorded, chip_ns, timeout_ms }
    }
}

/// How long the way from PreOP to OP takes over a chip, in nanoseconds, for a program that rests nowhere between its declarations and
/// SET_STATE. \[OURS] An estimate from what the model of a chip takes, which does an SDO in 3 ms: each SDO is a command of its own,
/// slaves have their mapping already, so that its objects are read and not written, and beside slaves that were found and are declared
/// none the others go from SafeOP to OP one by one.
pub fn time_to_op_ns(network: &Network) -> i64 {
    let sdos = |slave| {
        let data = ProcessData::of(network.role(slave), network.second_channels[slave - 1]);
        data.map_or(0, |data| {
            let downloads = data.downloads(DriveSync::DcSync);
            let others = downloads.into_iter().filter(|download| !download.is_mapping()).count();
            downloads.mapping_images().count() + others
        })
    };
    let sdos: usize = network.slaves().map(sdos).sum();
    let none = network.length().saturating_sub(network.count());
    let alone_ns = if none > 0 { ALONE_NS } else { 0 };
    // There are 40 slaves at most, each with some SDOs.
    let [sdos, slaves, none] = [sdos, network.count(), none].map(|count| count as i64);
    let is_long = network.output_bytes().max(network.input_bytes()) > COMFORTABLE_SIZE.bytes();
    let size_ns = if is_long { SIZE_NS } else { 0 };
    ALL_NS + size_ns + sdos * SDO_NS + slaves * (SLAVE_NS + alone_ns) + none * NONE_NS
}

/// Measures how long a program's way to OP is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WayToOp {
    /// The state that was asked for, and when first.
    asked: Option<(MasterState, i64)>,
    /// How long the changes before took that belong to the same way, in nanoseconds. What a program does between them does not count.
    passed_ns: i64,
    longest: Option<(i64, Place)>,
}

impl WayToOp {
    /// The longest way to OP, in nanoseconds, and where it ended.
    pub(super) const fn longest(&self) -> Option<(i64, Place)> {
        self.longest
    }

    /// SET_STATE goes by while the board is in a state.
    pub(super) fn asks(&mut self, present: Option<MasterState>, state: MasterState, place: Place) {
        if state < MasterState::SafeOp {
            self.ends();
        } else if present.is_none_or(|present| present < state) {
            let since_ns = self.asked.map_or(place.at_ns, |(_, since_ns)| since_ns);
            self.asked = Some((state, since_ns));
        }
    }

    /// A report shows a state, and the one before it another one or the same.
    pub(super) fn shows(&mut self, before: StateByte, now: StateByte, place: Place) {
        if now.is_failed() && now != before {
            return self.ends();
        }
        let Some((wanted, since_ns)) = self.asked else { return };
        if now.is_failed() || now.state().is_none_or(|state| state < wanted) {
            return;
        }
        self.asked = None;
        self.passed_ns = self.passed_ns.saturating_add(place.at_ns.saturating_sub(since_ns).max(0));
        if wanted == MasterState::Op {
            let passed_ns = std::mem::take(&mut self.passed_ns);
            if self.longest.is_none_or(|(longest, _)| passed_ns > longest) {
                self.longest = Some((passed_ns, place));
            }
        }
    }

    /// The way ends before OP.
    pub(super) fn ends(&mut self) {
        (self.asked, self.passed_ns) = (None, 0);
    }
}
