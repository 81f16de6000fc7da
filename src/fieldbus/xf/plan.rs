//! Computes whether a cycle time can be kept with an ECM-XF, and the settings for it: the packet size, the number of
//! exchanges of process data in flight, and the number of sets of outputs on the way to the chip.

use crate::ethercat::Ns;
use crate::fieldbus::HardwareLimit;
use crate::xf::DataSize;
use crate::xf::host::{Budget, BudgetError};

/// The maximum number of exchanges of process data in flight.
pub(super) const IN_FLIGHT_MAX: usize = 2;
/// The maximum number of sets of outputs per exchange that a plan relies on. An exchange carries more only if more sets
/// wait. \[OURS]
const SETS_MAX: usize = 8;
/// For each exchange of process data, a plan leaves time for this number of packets: two for the exchange itself, and
/// two for a command in between, because the AL states of the slaves are also read in OP. \[OURS]
const PACKETS_A_TURN: u32 = 4;
/// The maximum time, in half turns, for which a set of outputs counts as being in the chip after it was handed over. A
/// half turn is the time of [`PACKETS_A_TURN`] / 2 packets. The set is first in flight, and later the fill levels that
/// show it as sent lag two exchanges (OBS). \[OURS] The number of sets on the way is the number of cycles in this time,
/// plus one. With so many sets the chip's model never has to repeat outputs, whatever the packet size.
const HALF_TURNS_KNOWN: u64 = 5;

/// What a cycle requires of the exchanges with the chip.
///
/// ```
/// use ecmsk::fieldbus::HardwareLimit;
/// use ecmsk::fieldbus::xf::plan::CycleDemand;
/// use ecmsk::xf::DataSize;
///
/// let forty_drives = CycleDemand {
///     process_bytes: 400,
///     fifo_entries: 25,
///     cycle_ns: 1_000_000,
///     clock_hz: Some(24_000_000),
///     idle_ns: 150_000,
///     present: DataSize::NEWER,
///     size_is_fixed: false,
/// };
/// assert_eq!(forty_drives.plan().map(|plan| (plan.size.bytes(), plan.transport_sets)), Ok((800, 6)));
/// let refused = CycleDemand { cycle_ns: 250_000, ..forty_drives }.plan();
/// assert!(matches!(refused, Err(HardwareLimit::Cycle { cycle_ns: 250_000, .. })));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CycleDemand {
    /// The number of bytes of all outputs or of all inputs of a cycle, whichever is larger.
    pub process_bytes: usize,
    /// The number of entries that each of the chip's FIFOs has ([`fifo_entries`](super::fifo_entries)).
    pub fifo_entries: u8,
    /// The cycle time that has to be kept, in nanoseconds.
    pub cycle_ns: Ns,
    /// The SPI clock in Hz; `None`: the link has no clock, and bytes take no time.
    pub clock_hz: Option<u32>,
    /// The idle time after each exchange in nanoseconds.
    pub idle_ns: Ns,
    /// The data segment size n that the chip has at present.
    pub present: DataSize,
    /// Whether the data segment size of the chip cannot be changed.
    pub size_is_fixed: bool,
}

/// The settings of the chip and the bus with which a cycle time can be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CyclePlan {
    /// The data segment size n of the chip's packets.
    pub size: DataSize,
    /// How many exchanges of process data are in flight, 1 or 2. With 1 a set of outputs that the chip has not accepted
    /// is written again, so that none is lost while packets get through at least sometimes. With 2 such a set is given
    /// up and counted.
    pub in_flight: usize,
    /// How many sets of outputs a packet of this size carries, at most 8. With that many the cycle time can be kept.
    pub sets: u16,
    /// How many sets of outputs have to be handed over ahead of their cycle so that none is late while the host is on
    /// time: the sets in flight, and those that the chip has sent while the host does not know it yet.
    pub transport_sets: u16,
}

impl CycleDemand {
    /// Finds settings with which the cycle time can be kept. The present data segment size is tried before others, and
    /// one exchange of process data in flight before two. An exchange that carries several sets of outputs serves that
    /// many cycles.
    ///
    /// # Errors
    /// The exchanges take longer than the cycle, or the process data do not fit into a packet.
    pub fn plan(&self) -> Result<CyclePlan, HardwareLimit> {
        let Self { cycle_ns, present, .. } = *self;
        let bytes = self.process_bytes.max(1);
        let sets_max = SETS_MAX.min(self.fifo_entries.into()).max(1);
        let mut needed_ns = Ns::MAX;
        for in_flight in 1..=IN_FLIGHT_MAX {
            let sets = (present.bytes() / bytes).min(sets_max);
            let as_it_is = (sets > 0).then(|| self.budget(sets, in_flight).check(present).map(|()| present));
            let others = (1..=sets_max).take_while(|_| !self.size_is_fixed);
            let others = others.map(|sets| (sets, self.budget(sets, in_flight).choose_size()));
            for (sets, tried) in as_it_is.map(|tried| (sets, tried)).into_iter().chain(others) {
                match tried {
                    // \[OURS] Plans with two exchanges in flight and several sets of outputs in each are left out: no
                    // such plan was observed to keep its cycle time.
                    Ok(size) if in_flight > 1 && size.bytes() >= 2 * bytes => {}
                    Ok(size) => {
                        let sets = (size.bytes() / bytes).min(sets_max) as u16;
                        return Ok(CyclePlan { size, in_flight, sets, transport_sets: self.transport_sets(size) });
                    }
                    Err(BudgetError::CycleTooShort { needed_ns: together_ns, .. }) => {
                        needed_ns = needed_ns.min(together_ns.div_ceil(sets as Ns));
                    }
                    Err(_) => {}
                }
            }
        }
        Err(if needed_ns == Ns::MAX {
            let most = if self.size_is_fixed { present } else { DataSize::MAX };
            HardwareLimit::ProcessData { bytes, most: most.bytes() }
        } else {
            HardwareLimit::Cycle { cycle_ns, needed_ns }
        })
    }

    fn transport_sets(&self, size: DataSize) -> u16 {
        let turn = Budget { exchanges: PACKETS_A_TURN, ..self.budget(1, 1) };
        let known_ns = turn.needed_ns(size).saturating_mul(HALF_TURNS_KNOWN) / 2;
        u16::try_from(known_ns.div_ceil(self.cycle_ns) + 1).unwrap_or(u16::MAX)
    }

    fn budget(&self, sets: usize, in_flight: usize) -> Budget {
        Budget {
            process_bytes: sets * self.process_bytes,
            clock_hz: self.clock_hz.unwrap_or(u32::MAX),
            idle_ns: self.idle_ns,
            cycle_ns: sets as Ns * self.cycle_ns,
            exchanges: exchanges_of_process_data(in_flight),
        }
    }
}

/// For each exchange of process data, the number of exchanges of packets for which a plan leaves time. The answer to an
/// exchange comes with the next one. If only one exchange of process data is in flight, a command with two exchanges of
/// its own may come in between. \[OURS]
const fn exchanges_of_process_data(in_flight: usize) -> u32 {
    if in_flight > 1 { 2 } else { 4 }
}
