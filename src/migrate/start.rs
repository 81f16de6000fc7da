//! The way to OP: how long it was in the recording, and how long it is with the slaves behind a chip.

use super::{Network, Place};
use crate::ethercat::cia402::Mode;
use crate::fieldbus::Role;
use crate::fieldbus::pdo::{Download, ProcessData};
use crate::fieldbus::xf::fifo_entries;
use crate::fieldbus::xf::plan::CycleDemand;
use crate::sk::{DriveSync, MasterState, StateByte};
use crate::xf::host::{COMFORTABLE_SIZE, HostConfig};
use crate::xf::{DataSize, HEADER_LEN, TRAILER_LEN};

/// How long a change of state may take on a board, and over a chip if its link says nothing else, in nanoseconds (SK-4.55).
const STATE_TIMEOUT_NS: i64 = 10_000_000_000;
/// `state_timeout_ms=` is this many times as long as the way to OP, in tenths, where that may take longer than a board waits: real
/// slaves may need three times as long as those of the model. \[OURS]
const SPARE_TENTHS: i64 = 30;
/// The clock of SPI in Hz that the estimate is for, and the idle time behind a packet (XF EN 1706). \[OURS]
const CLOCK_HZ: u32 = 24_000_000;
const IDLE_NS: i64 = HostConfig::DEFAULT.idle_ns.cast_signed();
/// What the model of a chip takes, in nanoseconds, as far as it is no packet of the process data. \[OURS] Each is as it was measured
/// with the shortest packets. An SDO that writes, and one that reads, until its end is seen; and what an abort code takes beside
/// that.
const WRITE_NS: i64 = 3_518_000;
const READ_NS: i64 = 3_914_000;
const ABORT_NS: i64 = 2 * 396_000;
/// The layout of the process data, and what each slave adds to it beside the questions for its place.
const LAYOUT_NS: i64 = 24_163_000;
const LAYOUT_SLAVE_NS: i64 = 10_000_000;
/// What is set up before SafeOP; where the packets get another size, beside those that have it.
const FIFO_NS: i64 = 7_400_000;
const SIZE_NS: i64 = 102_772_000;
/// SafeOP of all, OP of all, and what each slave adds to either; what is done in OP, whoever goes there.
const SAFEOP_NS: i64 = 303_500_000;
const ALL_TO_OP_NS: i64 = 50_000_000;
const OP_NS: i64 = 6_000_000;
const CHANGE_SLAVE_NS: i64 = 2_000_000;
/// OP of a slave that goes there alone, as all do beside one that is declared none; and the way back from SafeOP of that one.
const ALONE_NS: i64 = 52_600_000;
const NONE_NS: i64 = 22_800_000;

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
    let transfers =
        network.slaves().map(|slave| Transfers::of(network, slave)).fold(Transfers::default(), Transfers::and);
    // There are 40 slaves at most.
    let [found, used] = [network.length(), network.count()].map(|count| count as i64);
    let none = found - used;
    let data = data_size(network);
    let [short_ns, packet_ns] = [COMFORTABLE_SIZE, data].map(packet_ns);
    let set_up_ns =
        if data == COMFORTABLE_SIZE { FIFO_NS + found * 2 * short_ns } else { SIZE_NS + (found * 2 + 32) * packet_ns };
    let op_ns = match none {
        0 => ALL_TO_OP_NS + found * CHANGE_SLAVE_NS,
        _ => used * ALONE_NS + none * NONE_NS,
    };
    // In each change the state of each slave is read twice, beside the exchanges of process data.
    let states_ns = 2 * found * beside_process_data_ns(2 * packet_ns, network.cycle.ns().cast_signed());
    let ns = transfers.ns()
        + found * 2 * short_ns
        + LAYOUT_NS
        + found * (LAYOUT_SLAVE_NS + 4 * short_ns)
        + set_up_ns
        + (SAFEOP_NS + found * CHANGE_SLAVE_NS + states_ns + 30 * packet_ns)
        + (OP_NS + op_ns + states_ns + 14 * packet_ns);
    // It is an estimate.
    ns / 1_000_000 * 1_000_000
}

/// The SDOs of a configuration.
#[derive(Clone, Copy, Debug, Default)]
struct Transfers {
    reads: i64,
    writes: i64,
    /// Those of them that a slave aborts, without a consequence.
    aborted: i64,
}

impl Transfers {
    fn of(network: &Network, slave: usize) -> Self {
        let role = network.role(slave);
        let Some(data) = ProcessData::of(role, network.second_channels[slave - 1]) else { return Self::default() };
        let downloads = data.downloads(DriveSync::DcSync);
        let others = downloads.into_iter().filter(|download| !download.is_mapping());
        // A pulse module is asked for its second channel.
        let asks_for_channel = matches!(role, Role::Hsp(_));
        // A slave without clocks has no synchronization types.
        let without_clock = role == Role::Io;
        Self {
            reads: downloads.mapping_images().count() as i64 + i64::from(asks_for_channel),
            writes: others.clone().count() as i64,
            aborted: if without_clock { others.filter(Download::is_sync_type).count() as i64 } else { 0 },
        }
    }

    const fn and(self, other: Self) -> Self {
        Self {
            reads: self.reads + other.reads,
            writes: self.writes + other.writes,
            aborted: self.aborted + other.aborted,
        }
    }

    const fn ns(self) -> i64 {
        self.reads * READ_NS + self.writes * WRITE_NS + self.aborted * ABORT_NS
    }
}

/// The packets with which the cycle holds. \[OURS] A slave that is declared none is laid out, too, and counts as a drive.
fn data_size(network: &Network) -> DataSize {
    let data = |slave| match network.role(slave) {
        Role::Unused => ProcessData::of(Role::Drive(Mode::Csp), false),
        role => ProcessData::of(role, network.second_channels[slave - 1]),
    };
    let sum = |bytes: fn(&ProcessData) -> usize| -> usize {
        (1..=network.length()).filter_map(data).map(|data| bytes(&data)).sum()
    };
    let [output_bytes, input_bytes] = [sum(ProcessData::output_bytes), sum(ProcessData::input_bytes)];
    let demand = CycleDemand {
        process_bytes: output_bytes.max(input_bytes),
        fifo_entries: fifo_entries(output_bytes + input_bytes),
        cycle_ns: network.cycle.ns(),
        clock_hz: Some(CLOCK_HZ),
        idle_ns: HostConfig::DEFAULT.idle_ns,
        present: COMFORTABLE_SIZE,
        size_is_fixed: false,
    };
    demand.plan().map_or(COMFORTABLE_SIZE, |plan| plan.size)
}

/// How long a packet takes, with the idle time behind it.
fn packet_ns(size: DataSize) -> i64 {
    (HEADER_LEN + size.bytes() + TRAILER_LEN) as i64 * 8_000_000_000 / i64::from(CLOCK_HZ) + IDLE_NS
}

/// How long a command takes beside an exchange of process data in each cycle, which takes as long as it; if both do not fit into a
/// cycle they alternate.
fn beside_process_data_ns(command_ns: i64, cycle_ns: i64) -> i64 {
    if 2 * command_ns < cycle_ns { command_ns * cycle_ns / (cycle_ns - command_ns) } else { 2 * command_ns }
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
