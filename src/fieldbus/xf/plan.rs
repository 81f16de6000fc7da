//! How a cycle is held over an ECM-XF, or that it is not: which size the packets have, how many exchanges of process data
//! are under way, and how many sets of outputs the transport takes.

use crate::ethercat::Ns;
use crate::fieldbus::HardwareLimit;
use crate::xf::DataSize;
use crate::xf::host::{Budget, BudgetError};

/// The most exchanges of process data that are under way.
pub(super) const IN_FLIGHT_MAX: usize = 2;
/// The most sets of outputs that an exchange carries to hold a cycle: more are sent only where more wait. \[OURS]
const SETS_MAX: usize = 8;
/// The packets of a turn: two for an exchange of process data, and two for a command beside it, since the states of the
/// slaves are read while they move. \[OURS]
const PACKETS_A_TURN: u32 = 4;
/// So many half turns after it was handed over a set may still count as one that lies in the chip: it is under way, and the
/// counts that tell that it was sent are two exchanges old (OBS). \[OURS] With as many sets and one more no cycle of the
/// model's repeats its outputs, whatever the packets.
const HALF_TURNS_KNOWN: u64 = 5;

/// What a cycle asks of the exchanges with the chip.
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
    /// Bytes of all outputs or of all inputs of a cycle, whichever are more.
    pub process_bytes: usize,
    /// Entries of each of the chip's FIFOs ([`fifo_entries`](super::fifo_entries)).
    pub fifo_entries: u8,
    /// The cycle in nanoseconds.
    pub cycle_ns: Ns,
    /// The clock of SPI in Hz; `None`: the link has none, and bytes take no time.
    pub clock_hz: Option<u32>,
    /// The idle time behind each exchange in nanoseconds.
    pub idle_ns: Ns,
    /// The n that the chip has.
    pub present: DataSize,
    /// It can have no other.
    pub size_is_fixed: bool,
}

/// How a cycle is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CyclePlan {
    /// The n to use.
    pub size: DataSize,
    /// How many exchanges of process data are under way, 1 or 2. With 1 none is ever lost while packets get through at
    /// all; with 2 a set that the chip did not take is given up and counted.
    pub in_flight: usize,
    /// How many sets of outputs a packet holds, of those that are sent together to hold the cycle: 8 at most.
    pub sets: u16,
    /// How many sets of outputs have to be handed over ahead of their cycle so that none is late while the host is not:
    /// those under way, and those of which nobody knows yet that they were sent.
    pub transport_sets: u16,
}

impl CycleDemand {
    /// How the cycle is held. What takes the least is tried first: the n that there is before others, and one exchange of
    /// process data at a time before two. An exchange that carries several sets of outputs holds as many cycles.
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
                    // [OURS] Two under way with several sets in each were not seen to hold.
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

/// How many exchanges pass for each one of process data: it has its answer with the one behind it, and where one is under
/// way at a time, a command with its own two may come between. \[OURS]
const fn exchanges_of_process_data(in_flight: usize) -> u32 {
    if in_flight > 1 { 2 } else { 4 }
}
