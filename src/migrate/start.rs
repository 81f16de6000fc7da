//! The start to OP: how long it took in the recording, and how long it takes over a chip.

use super::{Network, Place};
use crate::fieldbus::pdo::ProcessData;
use crate::sk::{DriveSync, MasterState, StateByte};
use crate::xf::host::COMFORTABLE_SIZE;

/// Timeout of a change of state on a board, and the default over a chip, in nanoseconds (SK-4.55).
const STATE_TIMEOUT_NS: i64 = 10_000_000_000;
/// `state_timeout_ms=` in tenths of the estimated start to OP: real slaves may take three times as long as those of the
/// model. It is set only if it exceeds the board's timeout. \[OURS]
const SPARE_TENTHS: i64 = 30;
/// Time that does not depend on the slaves: two changes of state of all slaves, and the layout of the process image.
/// \[OURS]
const ALL_NS: i64 = 405_000_000;
/// Time to change the packet size, if the process data do not fit into the default size. \[OURS]
const SIZE_NS: i64 = 110_000_000;
/// Time for a slave without its SDOs: its place in the layout, its part of each change of state, reading its states.
/// \[OURS]
const SLAVE_NS: i64 = 22_000_000;
/// Time for one SDO of the configuration, which writes an object or reads one of the mapping, with its packets. \[OURS]
const SDO_NS: i64 = 3_800_000;
/// Additional time for a slave that changes to OP alone. All slaves do so if one of them is declared as none. \[OURS]
const ALONE_NS: i64 = 50_000_000;
/// Time for a slave that is declared as none: it returns from SafeOP. \[OURS]
const NONE_NS: i64 = 35_000_000;

/// The start to OP, on the recorded board and over a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Start {
    /// The longest time from SET_STATE to OP in the recording, in nanoseconds, and the report that showed OP. `None` if
    /// SET_STATE never led to OP.
    pub recorded: Option<(i64, Place)>,
    /// The estimated time over a chip, in nanoseconds: [`time_to_op_ns`].
    pub chip_ns: i64,
    /// The value of `state_timeout_ms=` for the links, if a change of state may take longer than the default timeout.
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

/// The estimated time from PreOP to OP over a chip, in nanoseconds, for a program that does not wait between its
/// declarations and SET_STATE. \[OURS] It comes from the model of a chip, which takes 3 ms for an SDO: each SDO is a
/// command of its own. The objects of the mapping are only read, because slaves have their mapping already. If slaves
/// are declared as none, the others change from SafeOP to OP one after the other.
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
    // These casts cannot overflow: there are at most 40 slaves, each with some SDOs.
    let [sdos, slaves, none] = [sdos, network.count(), none].map(|count| count as i64);
    let is_long = network.output_bytes().max(network.input_bytes()) > COMFORTABLE_SIZE.bytes();
    let size_ns = if is_long { SIZE_NS } else { 0 };
    ALL_NS + size_ns + sdos * SDO_NS + slaves * (SLAVE_NS + alone_ns) + none * NONE_NS
}

/// Measures how long a program's start to OP takes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WayToOp {
    /// The requested state, and the time of the first request.
    asked: Option<(MasterState, i64)>,
    /// The time that earlier changes of state of the same start took, in nanoseconds. What the program does between
    /// them does not count.
    passed_ns: i64,
    longest: Option<(i64, Place)>,
}

impl WayToOp {
    /// The longest start to OP, in nanoseconds, and the report that showed OP.
    pub(super) const fn longest(&self) -> Option<(i64, Place)> {
        self.longest
    }

    /// Takes a SET_STATE; `present` is the state of the board.
    pub(super) fn asks(&mut self, present: Option<MasterState>, state: MasterState, place: Place) {
        if state < MasterState::SafeOp {
            self.ends();
        } else if present.is_none_or(|present| present < state) {
            let since_ns = self.asked.map_or(place.at_ns, |(_, since_ns)| since_ns);
            self.asked = Some((state, since_ns));
        }
    }

    /// Takes the state of a report, and that of the report before it.
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

    /// Ends a start that does not reach OP.
    pub(super) fn ends(&mut self) {
        (self.asked, self.passed_ns) = (None, 0);
    }
}
