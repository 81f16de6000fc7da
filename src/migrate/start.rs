//! The start to OP: how long it took in the recording, and how long it takes over a chip.

use super::{Network, Place};
use crate::ethercat::cia402::Mode;
use crate::fieldbus::Role;
use crate::fieldbus::pdo::{Download, ProcessData};
use crate::fieldbus::xf::fifo_entries;
use crate::fieldbus::xf::plan::CycleDemand;
use crate::sk::{DriveSync, MasterState, StateByte};
use crate::xf::host::{COMFORTABLE_SIZE, HostConfig};
use crate::xf::{DataSize, HEADER_LEN, TRAILER_LEN};

/// Timeout of a change of state on a board, and the default over a chip, in nanoseconds (SK-4.55).
const STATE_TIMEOUT_NS: i64 = 10_000_000_000;
/// The ratio of `state_timeout_ms=` to the estimated start to OP, in tenths: real slaves may take three times as long as
/// those of the model. The key is set only if the result exceeds the board's timeout. \[OURS]
const SPARE_TENTHS: i64 = 30;
/// The SPI clock for which the start is estimated, Hz. \[OURS]
const CLOCK_HZ: u32 = 24_000_000;
/// The idle time after each packet, ns (XF EN 1706).
const IDLE_NS: i64 = HostConfig::DEFAULT.idle_ns.cast_signed();
/// The duration of an SDO download over the model of a chip, ns. This time and the following ones were measured with
/// the shortest packets, without packets of process data. \[OURS]
const WRITE_NS: i64 = 3_518_000;
/// The duration of an SDO upload, ns.
const READ_NS: i64 = 3_914_000;
/// The additional time of an SDO transfer that ends with an abort code, ns.
const ABORT_NS: i64 = 2 * 396_000;
/// The duration of the chip's command that lays out the process data of all slaves in the process image, ns, without
/// the part of each slave.
const LAYOUT_NS: i64 = 24_163_000;
/// The additional duration of that command for each slave, ns, without the packets that afterwards ask where the
/// slave's process data are in the image.
const LAYOUT_SLAVE_NS: i64 = 10_000_000;
/// The duration of the FIFO set-up before SafeOP, ns.
const FIFO_NS: i64 = 7_400_000;
/// The duration of a change of the packet size, without the packets of the new size, ns.
const SIZE_NS: i64 = 102_772_000;
/// The duration of the change of all slaves to SafeOP, ns.
const SAFEOP_NS: i64 = 303_500_000;
/// The duration of the change of all slaves to OP with one command, ns.
const ALL_TO_OP_NS: i64 = 50_000_000;
/// The part of the change to OP that depends on neither the slaves nor the packets, ns.
const OP_NS: i64 = 6_000_000;
/// The additional duration of a change of state for each slave, ns.
const CHANGE_SLAVE_NS: i64 = 2_000_000;
/// The duration of the change to OP for a slave that changes alone, ns. If a slave is declared as none, the others change
/// one after the other.
const ALONE_NS: i64 = 52_600_000;
/// The duration of the return from SafeOP of a slave that is declared as none, ns.
const NONE_NS: i64 = 22_800_000;

/// The start to OP, on the recorded board and over a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Start {
    /// The longest time from SET_STATE to OP in the recording, in nanoseconds, and the report that showed OP. `None` if
    /// SET_STATE never led to OP.
    pub recorded: Option<(i64, Place)>,
    /// The estimated time over a chip, in nanoseconds: [`time_to_op_ns`].
    pub chip_ns: i64,
    /// The value of `state_timeout_ms=` for the links, if a change of state may take longer than the default timeout;
    /// `None`: the default is enough.
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
    let transfers =
        network.slaves().map(|slave| Transfers::of(network, slave)).fold(Transfers::default(), Transfers::and);
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
    // In each change of state, the state of each slave is read twice, in addition to the exchanges of process data.
    let states_ns = 2 * found * beside_process_data_ns(2 * packet_ns, network.cycle.ns().cast_signed());
    let ns = transfers.ns()
        + found * 2 * short_ns
        + LAYOUT_NS
        + found * (LAYOUT_SLAVE_NS + 4 * short_ns)
        + set_up_ns
        + (SAFEOP_NS + found * CHANGE_SLAVE_NS + states_ns + 30 * packet_ns)
        + (OP_NS + op_ns + states_ns + 14 * packet_ns);
    // Whole milliseconds: more digits would suggest a precision that an estimate does not have.
    ns / 1_000_000 * 1_000_000
}

/// The number of SDO transfers that configure one slave or several.
#[derive(Clone, Copy, Debug, Default)]
struct Transfers {
    reads: i64,
    writes: i64,
    /// The number of transfers that the slave aborts, without consequence.
    aborted: i64,
}

impl Transfers {
    fn of(network: &Network, slave: usize) -> Self {
        let role = network.role(slave);
        let Some(data) = ProcessData::of(role, network.second_channels[slave - 1]) else { return Self::default() };
        let downloads = data.downloads(DriveSync::DcSync);
        let others = downloads.into_iter().filter(|download| !download.is_mapping());
        // A slave without distributed clocks has no objects for the synchronization type (0x1C32, 0x1C33), so it aborts
        // the transfers that write them.
        let without_clock = role == Role::Io;
        Self {
            reads: downloads.mapping_images().count() as i64 + i64::from(ProcessData::probe(role).is_some()),
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

/// The size of the packets for process data in each cycle. \[OURS] A slave that is declared as none is part of the layout,
/// too, and counts as a drive.
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

/// The duration of a packet with the idle time after it, ns.
fn packet_ns(size: DataSize) -> i64 {
    (HEADER_LEN + size.bytes() + TRAILER_LEN) as i64 * 8_000_000_000 / i64::from(CLOCK_HZ) + IDLE_NS
}

/// The duration of a command while each cycle has an exchange of process data that is as long as the command, ns. If a cycle
/// has no time for both, they alternate.
fn beside_process_data_ns(command_ns: i64, cycle_ns: i64) -> i64 {
    if 2 * command_ns < cycle_ns { command_ns * cycle_ns / (cycle_ns - command_ns) } else { 2 * command_ns }
}

/// Measures how long a program's start to OP takes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WayToOp {
    /// The requested state, and the time of the first request. `None`: no change of state is in progress.
    asked: Option<(MasterState, i64)>,
    /// The time that earlier changes of state of the same start took, in nanoseconds. What the program does between
    /// them does not count.
    passed_ns: i64,
    longest: Option<(i64, Place)>,
}

impl WayToOp {
    /// The longest start to OP, in nanoseconds, and the report that showed OP. `None` if no SET_STATE has led to OP.
    pub(super) const fn longest(&self) -> Option<(i64, Place)> {
        self.longest
    }

    /// Processes a SET_STATE command for `state`; `present` is the state of the board.
    pub(super) fn asks(&mut self, present: Option<MasterState>, state: MasterState, place: Place) {
        if state < MasterState::SafeOp {
            self.ends();
        } else if present.is_none_or(|present| present < state) {
            let since_ns = self.asked.map_or(place.at_ns, |(_, since_ns)| since_ns);
            self.asked = Some((state, since_ns));
        }
    }

    /// Processes the state in a report, `now`, and that in the previous report, `before`.
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

    /// Forgets the present start, because it does not reach OP.
    pub(super) fn ends(&mut self) {
        (self.asked, self.passed_ns) = (None, 0);
    }
}
