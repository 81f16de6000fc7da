//! What the chip has to do for a network: the size of its packets, the clock of its SPI, the entries of its FIFOs. How a cycle is
//! held is up to the bus ([`CycleDemand`]).

use super::Network;
use crate::ethercat::Ns;
use crate::fieldbus::HardwareLimit;
use crate::fieldbus::xf::plan::CycleDemand;
use crate::fieldbus::xf::{XfBusOptions, fifo_entries};
use crate::sk::CycleTime;
use crate::xf::DataSize;
use crate::xf::host::HostConfig;

/// How long the chip takes for a packet where INT0 says when it is ready, in nanoseconds. \[OURS] The manual says less than
/// 150 us (XF EN, "ECM-XF Interrupt"); the model takes as long as this.
pub const INT0_IDLE_NS: Ns = 100_000;
/// How long nothing is sent behind a packet without INT0, in nanoseconds (XF EN 1706).
pub const IDLE_NS: Ns = HostConfig::DEFAULT.idle_ns;
/// The part of a cycle that the exchanges may take at the least clock, in tenths. \[OURS]
const USED_TENTHS: Ns = 9;
/// Clocks are told in steps of this, in Hz.
const CLOCK_STEP_HZ: u32 = 1000;

/// Packets with which a cycle holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packets {
    /// Bytes of data in a packet.
    pub size: DataSize,
    /// Sets of outputs that a packet holds.
    pub sets: u16,
    /// Exchanges of process data that are under way at a time. With 1 none is lost while packets get through at all; with 2
    /// a set that the chip did not take is not sent again.
    pub in_flight: usize,
    /// The least clock of SPI in Hz with which the cycle holds with one exchange under way and a tenth of the time to spare,
    /// be it with other packets; the clock that was given, if that is less.
    pub least_clock_hz: u32,
    /// How many sets have to lie in the chip for the transport alone, at the clock that was given: the bus adds them to
    /// `ahead=`.
    pub transport_sets: u16,
}

/// Why no packets hold a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// What the bus would refuse it with.
    pub limit: HardwareLimit,
    /// The shortest cycle that holds instead, with one exchange under way; `None`: none does.
    pub next_cycle: Option<CycleTime>,
    /// Whether INT0 is wired, so that wiring it is no advice.
    pub has_int0: bool,
}

impl Refused {
    /// Why, and what to do about it in general.
    pub fn reason(&self) -> String {
        match self.limit {
            HardwareLimit::Cycle { cycle_ns, needed_ns } if self.has_int0 => format!(
                "a cycle of {} us cannot be held: the exchanges with the chip take {} us for each; take a longer cycle (SET_DC), a \
                 faster clock (speed=) or fewer slaves",
                cycle_ns / 1000,
                needed_ns.div_ceil(1000)
            ),
            limit => limit.to_string(),
        }
    }
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
    /// The most cycles that `ahead=` bridges: what the chip's FIFO holds beside the transport.
    pub ahead_max: u16,
}

impl Needs {
    /// Those of a network with that cycle, on an SPI with that clock in Hz.
    pub fn of(network: &Network, clock_hz: u32) -> Self {
        let (output_bytes, input_bytes) = (network.output_bytes(), network.input_bytes());
        let entries = fifo_entries(output_bytes + input_bytes);
        let demand = |idle_ns| CycleDemand {
            process_bytes: output_bytes.max(input_bytes),
            fifo_entries: entries,
            cycle_ns: network.cycle.ns(),
            clock_hz: Some(clock_hz),
            idle_ns,
            present: DataSize::MANUAL,
            size_is_fixed: false,
        };
        let with_int0 = packets(&demand(INT0_IDLE_NS), clock_hz);
        let mut needs = Self {
            output_bytes,
            input_bytes,
            cycle: network.cycle,
            clock_hz,
            with_int0,
            without_int0: packets(&demand(IDLE_NS), clock_hz),
            entries,
            ahead_max: 0,
        };
        needs.ahead_max = u16::from(entries).saturating_sub(needs.transport_sets()).clamp(1, XfBusOptions::AHEAD_MAX);
        needs
    }

    /// Bytes of one set of process data in a packet: the larger direction.
    pub fn set_bytes(&self) -> usize {
        self.output_bytes.max(self.input_bytes)
    }

    /// How many sets the transport takes with INT0; 0 if the cycle cannot be held.
    pub fn transport_sets(&self) -> u16 {
        self.with_int0.map_or(0, |packets| packets.transport_sets)
    }

    /// The least n that holds one set.
    pub fn least_size(&self) -> Option<DataSize> {
        DataSize::new(self.set_bytes().max(DataSize::MIN.bytes()))
    }
}

/// The packets with which a cycle holds: those of 112 bytes, in which commands are comfortable, or as much larger ones as it
/// takes.
fn packets(demand: &CycleDemand, clock_hz: u32) -> Result<Packets, Refused> {
    let has_int0 = demand.idle_ns == INT0_IDLE_NS;
    let refused = |limit| Refused { limit, next_cycle: next_cycle(demand), has_int0 };
    let plan = demand.plan().map_err(refused)?;
    Ok(Packets {
        size: plan.size,
        sets: plan.sets,
        in_flight: plan.in_flight,
        least_clock_hz: least_clock_hz(demand, clock_hz),
        transport_sets: plan.transport_sets,
    })
}

/// The shortest longer cycle that holds with one exchange under way.
fn next_cycle(demand: &CycleDemand) -> Option<CycleTime> {
    let us = (demand.cycle_ns / 1000) as u32;
    let longer = std::iter::successors(CycleTime::from_us(us * 2), |cycle| CycleTime::from_us(cycle.us() * 2));
    longer
        .into_iter()
        .find(|cycle| CycleDemand { cycle_ns: cycle.ns(), ..*demand }.plan().is_ok_and(|plan| plan.in_flight == 1))
}

/// The least clock with which the cycle holds with one exchange under way and some time to spare, in steps of
/// [`CLOCK_STEP_HZ`]; at most the one that there is.
fn least_clock_hz(demand: &CycleDemand, clock_hz: u32) -> u32 {
    let cycle_ns = demand.cycle_ns * USED_TENTHS / 10;
    let holds = |steps: u32| {
        let clock_hz = Some(steps.saturating_mul(CLOCK_STEP_HZ));
        CycleDemand { clock_hz, cycle_ns, ..*demand }.plan().is_ok_and(|plan| plan.in_flight == 1)
    };
    let (mut too_slow, mut enough) = (0, clock_hz.div_ceil(CLOCK_STEP_HZ));
    while enough - too_slow > 1 {
        let middle = too_slow + (enough - too_slow) / 2;
        if holds(middle) { enough = middle } else { too_slow = middle }
    }
    enough.saturating_mul(CLOCK_STEP_HZ).min(clock_hz)
}
