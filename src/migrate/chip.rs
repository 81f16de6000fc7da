//! What a chip needs for the process data of a network: the size of its packets, the SPI clock, the entries of its FIFOs.
//! [`CycleDemand`] calculates whether the exchanges with the chip fit into the cycle time.

use super::Network;
use crate::ethercat::Ns;
use crate::fieldbus::HardwareLimit;
use crate::fieldbus::xf::plan::CycleDemand;
use crate::fieldbus::xf::{XfBusOptions, fifo_entries};
use crate::sk::CycleTime;
use crate::xf::DataSize;
use crate::xf::host::HostConfig;

/// Time that the chip needs for a packet if INT0 shows when it is ready, in nanoseconds. \[OURS] The manual says less
/// than 150 us (XF EN, "ECM-XF Interrupt"); the model of the chip takes 100 us.
pub const INT0_IDLE_NS: Ns = 100_000;
/// Idle time after each packet without INT0, in nanoseconds (XF EN 1706).
pub const IDLE_NS: Ns = HostConfig::DEFAULT.idle_ns;
/// How many tenths of a cycle the exchanges may take at the lowest recommended SPI clock. \[OURS]
const USED_TENTHS: Ns = 9;
/// Clocks are rounded up to multiples of this, in Hz.
const CLOCK_STEP_HZ: u32 = 1000;

/// Packets with which the exchanges of process data fit into the cycle time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packets {
    /// The size of the packets' data segment.
    pub size: DataSize,
    /// The number of process images, one for each cycle, that one packet carries.
    pub sets: u16,
    /// The exchanges of process data that are in flight at the same time. With 1 no outputs are lost as long as packets
    /// get through at all. With 2, outputs that the chip did not accept are not sent again.
    pub in_flight: usize,
    /// The lowest SPI clock in Hz at which one exchange in flight fits into the cycle with a tenth of the time to
    /// spare. The packets at that clock may have another size than `size`. At most [`Needs::clock_hz`].
    pub least_clock_hz: u32,
    /// The number of process images that have to wait in the chip's FIFO to cover the latency of the transport, at the
    /// clock [`Needs::clock_hz`]. A board over the chip adds them to `ahead=`.
    pub transport_sets: u16,
}

/// Why the exchanges of process data do not fit into the cycle time with packets of any size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// The limit with which a board over the chip would refuse this cycle time.
    pub limit: HardwareLimit,
    /// The shortest longer cycle that is possible with one exchange in flight; `None` if there is none.
    pub next_cycle: Option<CycleTime>,
    /// Whether INT0 is wired. If not, [`Self::reason`] advises to wire it, since packets then need less time.
    pub has_int0: bool,
}

impl Refused {
    /// Why the cycle time is too short for the chip, with advice that holds for any program: a longer cycle, a faster
    /// clock or fewer slaves.
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

/// What a chip needs for the process data of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// The bytes of the outputs of all slaves.
    pub output_bytes: usize,
    /// The bytes of the inputs of all slaves.
    pub input_bytes: usize,
    /// The EtherCAT cycle time of the network in OP.
    pub cycle: CycleTime,
    /// The SPI clock of the machine, in Hz.
    pub clock_hz: u32,
    /// The packets to use if INT0 is wired, or why the cycle time is too short for any packets.
    pub with_int0: Result<Packets, Refused>,
    /// The packets to use without INT0, with the default idle time after each packet, or why the cycle time is too short
    /// for any packets.
    pub without_int0: Result<Packets, Refused>,
    /// The number of entries that each of the chip's two FIFOs has, 1..=64. The FIFOs share 16 KB, so the more process
    /// data there are, the fewer entries fit.
    pub entries: u8,
    /// The largest useful value of `ahead=`: the entries of the chip's FIFO that are not needed to cover the latency of the
    /// transport.
    pub ahead_max: u16,
}

impl Needs {
    /// Calculates what a chip needs for a network at an SPI clock in Hz.
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

    /// The bytes of one process image in a packet: outputs or inputs, whichever are more.
    pub fn set_bytes(&self) -> usize {
        self.output_bytes.max(self.input_bytes)
    }

    /// The number of process images that have to wait in the chip's FIFO to cover the latency of the transport with INT0; 0
    /// if the cycle time is too short.
    pub fn transport_sets(&self) -> u16 {
        self.with_int0.map_or(0, |packets| packets.transport_sets)
    }

    /// The smallest packet size that holds one process image; `None` if none does.
    pub fn least_size(&self) -> Option<DataSize> {
        DataSize::new(self.set_bytes().max(DataSize::MIN.bytes()))
    }
}

/// The packets with which the exchanges fit into the cycle time: of 112 bytes, enough for every command of the
/// configuration, or larger if the process data need it.
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

/// The next longer cycle time that is possible with one exchange in flight; `None` if there is none.
fn next_cycle(demand: &CycleDemand) -> Option<CycleTime> {
    let us = (demand.cycle_ns / 1000) as u32;
    let longer = std::iter::successors(CycleTime::from_us(us * 2), |cycle| CycleTime::from_us(cycle.us() * 2));
    longer
        .into_iter()
        .find(|cycle| CycleDemand { cycle_ns: cycle.ns(), ..*demand }.plan().is_ok_and(|plan| plan.in_flight == 1))
}

/// The lowest clock at which one exchange in flight fits into the cycle with some time to spare, in steps of
/// [`CLOCK_STEP_HZ`]. At most the given clock.
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
