//! What the chip has to do for a network: the size of its packets, the clock of its SPI, the entries of its FIFOs.

use super::Network;
use crate::ethercat::Ns;
use crate::fieldbus::xf::{XfBusOptions, fifo_entries};
use crate::sk::CycleTime;
use crate::xf::DataSize;
use crate::xf::host::{Budget, BudgetError, COMFORTABLE_SIZE, HostConfig};

/// How long the chip takes for a packet where INT0 says when it is ready, in nanoseconds. \[OURS] The manual says less than
/// 150 us (XF EN, "ECM-XF Interrupt"); the model takes as long as this.
pub const INT0_IDLE_NS: Ns = 100_000;
/// How long nothing is sent behind a packet without INT0, in nanoseconds (XF EN 1706).
pub const IDLE_NS: Ns = HostConfig::DEFAULT.idle_ns;
/// The packets of a turn: two for an exchange of process data, and two for a command beside it, since the states of the
/// slaves are read while they move. \[OURS]
pub const PACKETS_A_TURN: u32 = 4;
/// With several sets in a packet this part of the time is left free, in tenths: exchanges that carry fewer take as long.
/// \[OURS] On the model nine tenths hold, and all of it does not.
const USED_TENTHS: Ns = 9;
/// The most sets of outputs in a packet (XF EN 1236).
const SETS_MAX: usize = 32;
/// So many turns after it was handed over a set still counts as one that lies in the chip: it is under way, it waits, and
/// the counts that tell that it was sent are two exchanges old (OBS). \[OURS] With as many sets no cycle of the model's
/// repeats its outputs, whatever the packets.
const TURNS_KNOWN: u64 = 7;
/// Clocks are told in steps of this, in Hz.
const CLOCK_STEP_HZ: u64 = 1000;

/// Packets with which a cycle holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packets {
    /// Bytes of data in a packet.
    pub size: DataSize,
    /// Sets of outputs that a packet holds.
    pub sets: u16,
    /// The least clock of SPI in Hz that holds the cycle with these packets.
    pub least_clock_hz: u32,
}

/// Why no packets hold a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// The sum for one set in a packet.
    pub sum: BudgetError,
    /// The shortest cycle that holds instead; `None`: none does.
    pub next_cycle: Option<CycleTime>,
}

/// What the process data of a network need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// Bytes of the outputs of all slaves.
    pub output_bytes: usize,
    /// Bytes of the inputs of all slaves.
    pub input_bytes: usize,
    /// The cycle.
    pub cycle: CycleTime,
    /// The clock of SPI that the machine has, in Hz.
    pub clock_hz: u32,
    /// With INT0.
    pub with_int0: Result<Packets, Refused>,
    /// Without INT0, with the default idle time behind each packet.
    pub without_int0: Result<Packets, Refused>,
    /// Entries of each FIFO in the memory that both share.
    pub entries: u8,
    /// The most that `ahead=` can be.
    pub ahead_max: u16,
}

impl Needs {
    /// Those of a network with that cycle, on an SPI with that clock in Hz.
    pub fn of(network: &Network, clock_hz: u32) -> Self {
        let (output_bytes, input_bytes) = (network.output_bytes(), network.input_bytes());
        let set_bytes = output_bytes.max(input_bytes);
        let plan = |idle_ns| plan(set_bytes, network.cycle, idle_ns, clock_hz);
        let entries = fifo_entries(output_bytes + input_bytes);
        Self {
            output_bytes,
            input_bytes,
            cycle: network.cycle,
            clock_hz,
            with_int0: plan(INT0_IDLE_NS),
            without_int0: plan(IDLE_NS),
            entries,
            ahead_max: XfBusOptions::AHEAD_MAX.min(entries.into()),
        }
    }

    /// Bytes of one set of process data in a packet: the larger direction.
    pub fn set_bytes(&self) -> usize {
        self.output_bytes.max(self.input_bytes)
    }

    /// The n to use with INT0; `None`: none holds the cycle. It is the least, or, if the cycle has the time for it,
    /// [`COMFORTABLE_SIZE`], in which commands are comfortable.
    pub fn chosen_size(&self) -> Option<DataSize> {
        let packets = self.with_int0.ok()?;
        let is_comfortable = packets.sets == 1 && self.turn().check(COMFORTABLE_SIZE).is_ok();
        Some(if is_comfortable { packets.size.max(COMFORTABLE_SIZE) } else { packets.size })
    }

    /// How many sets have to lie in the chip for the transport alone, with INT0 and packets of that size.
    pub fn transport_sets(&self, size: DataSize) -> u16 {
        self.transport_sets_with(size, INT0_IDLE_NS)
    }

    /// The same where the chip, or the host behind each packet, takes so long for one, in nanoseconds.
    pub fn transport_sets_with(&self, size: DataSize, idle_ns: Ns) -> u16 {
        let turns_ns = Budget { idle_ns, ..self.turn() }.needed_ns(size) * TURNS_KNOWN;
        u16::try_from(turns_ns.div_ceil(self.cycle.ns())).unwrap_or(u16::MAX)
    }

    /// A turn with INT0 and one set in a packet.
    fn turn(&self) -> Budget {
        Budget {
            process_bytes: self.set_bytes(),
            clock_hz: self.clock_hz,
            idle_ns: INT0_IDLE_NS,
            cycle_ns: self.cycle.ns(),
            exchanges: PACKETS_A_TURN,
        }
    }

    /// The least n that holds one set.
    pub fn least_size(&self) -> Option<DataSize> {
        DataSize::new(self.set_bytes().max(DataSize::MIN.bytes()))
    }
}

/// The smallest packets with which a cycle holds, one set in a packet or more.
fn plan(set_bytes: usize, cycle: CycleTime, idle_ns: Ns, clock_hz: u32) -> Result<Packets, Refused> {
    hold(set_bytes, cycle, idle_ns, clock_hz).map_err(|sum| {
        let longer =
            std::iter::successors(CycleTime::from_us(cycle.us() * 2), |cycle| CycleTime::from_us(cycle.us() * 2));
        let next_cycle = longer.into_iter().find(|longer| hold(set_bytes, *longer, idle_ns, clock_hz).is_ok());
        Refused { sum, next_cycle }
    })
}

fn hold(set_bytes: usize, cycle: CycleTime, idle_ns: Ns, clock_hz: u32) -> Result<Packets, BudgetError> {
    let mut refused = None;
    for sets in 1..=SETS_MAX {
        let process_bytes = sets * set_bytes.max(1);
        let cycles_ns = cycle.ns() * sets as Ns;
        let cycle_ns = if sets == 1 { cycles_ns } else { cycles_ns * USED_TENTHS / 10 };
        let budget = Budget { process_bytes, clock_hz, idle_ns, cycle_ns, exchanges: PACKETS_A_TURN };
        let size = DataSize::new(process_bytes.max(DataSize::MIN.bytes())).unwrap_or(DataSize::MAX);
        match budget.check(size) {
            Ok(()) => return Ok(packets(&budget, size, sets as u16)),
            Err(error) => {
                refused.get_or_insert(error);
            }
        }
    }
    Err(refused.unwrap_or(BudgetError::NoExchange))
}

fn packets(budget: &Budget, size: DataSize, sets: u16) -> Packets {
    let for_bytes_ns = (budget.cycle_ns / Ns::from(budget.exchanges)).saturating_sub(budget.idle_ns).max(1);
    let bit_seconds = size.packet_len() as u64 * 8 * 1_000_000_000;
    let least_hz = bit_seconds.div_ceil(for_bytes_ns).next_multiple_of(CLOCK_STEP_HZ);
    Packets { size, sets, least_clock_hz: u32::try_from(least_hz).unwrap_or(u32::MAX).min(budget.clock_hz) }
}
