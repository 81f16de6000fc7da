//! The duration of an exchange, and the choice of n (the size of the data segment) that process data need.

use core::fmt;

use crate::ethercat::Ns;
use crate::xf::DataSize;

/// The smallest data segment size n that is chosen if the cycle is long enough for it. `[OURS]` 112, the n of an ECM-XF
/// at power-on: PDO_CONFIG_SET needs 112 bytes.
pub const COMFORTABLE_SIZE: DataSize = DataSize::MANUAL;

/// The properties of a cycle from which n, the size of the data segment, is chosen.
///
/// ```
/// use ecmsk::xf::DataSize;
/// use ecmsk::xf::host::{Budget, BudgetError};
///
/// let budget =
///     Budget { process_bytes: 1024, clock_hz: 24_000_000, idle_ns: 150_000, cycle_ns: 1_000_000, exchanges: 1 };
/// assert_eq!(budget.transfer_ns(DataSize::NEWER), 352_000);
/// assert_eq!(budget.choose_size(), Ok(DataSize::NEWER));
/// let refused = Budget { cycle_ns: 500_000, ..budget }.choose_size();
/// assert!(matches!(refused, Err(BudgetError::CycleTooShort { needed_ns: 502_000, .. })));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Bytes of process data in one packet, at most 1408: of the RxPDOs or of the TxPDOs, whichever are larger.
    pub process_bytes: usize,
    /// The SPI clock in Hz. The chip allows at most 96 MHz (XF EN 147).
    pub clock_hz: u32,
    /// The idle time after each exchange, in nanoseconds; with INT0 the average time for which the chip is busy.
    pub idle_ns: Ns,
    /// The intended cycle time, in nanoseconds.
    pub cycle_ns: Ns,
    /// Number of exchanges per cycle: 1 with [`pipelined_writes`](super::HostConfig::pipelined_writes) and no other
    /// command in each cycle, otherwise 2 or more.
    pub exchanges: u32,
}

/// Why a cycle time is not possible. Remedies are a longer cycle, a faster clock, less idle time by means of INT0,
/// fewer process data, or pipelined writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BudgetError {
    /// The process data do not fit into a packet.
    TooManyBytes {
        /// Size in bytes of the RxPDOs or of the TxPDOs of one packet, whichever are larger.
        process_bytes: usize,
        /// The number of bytes that the data segment of a packet holds: the size that [`Budget::check`] was asked
        /// about, or 1408 in [`Budget::choose_size`], where no size is large enough.
        most: usize,
    },
    /// The clock frequency or the number of exchanges is 0.
    NoExchange,
    /// The exchanges of a cycle take longer than the cycle.
    CycleTooShort {
        /// The data segment size with which the exchanges were calculated.
        size: DataSize,
        /// The SPI clock in Hz.
        clock_hz: u32,
        /// Transfer time of one packet, in nanoseconds.
        transfer_ns: Ns,
        /// Idle time after each packet, in nanoseconds.
        idle_ns: Ns,
        /// Number of exchanges with the chip per cycle.
        exchanges: u32,
        /// Total time of the exchanges with their idle times, in nanoseconds.
        needed_ns: Ns,
        /// The intended cycle time, in nanoseconds.
        cycle_ns: Ns,
    },
}

impl Budget {
    /// The transfer time of one packet in nanoseconds, rounded up; `Ns::MAX` without a clock. 1056 bytes take 352 us at
    /// 24 MHz.
    pub const fn transfer_ns(&self, size: DataSize) -> Ns {
        if self.clock_hz == 0 {
            return Ns::MAX;
        }
        // No overflow: 1440 bytes give 1.2e13 bit * ns/s, far below 2^64.
        (size.packet_len() as u64 * 8 * 1_000_000_000).div_ceil(self.clock_hz as u64)
    }

    /// The duration of one cycle's exchanges with this data segment size in nanoseconds, including the idle time after
    /// each.
    pub const fn needed_ns(&self, size: DataSize) -> Ns {
        self.transfer_ns(size).saturating_add(self.idle_ns).saturating_mul(self.exchanges as u64)
    }

    /// Checks that the exchanges of a cycle with this data segment size fit into the cycle.
    ///
    /// # Errors
    /// [`BudgetError`] with the calculation, if the exchanges do not fit into the cycle or the process data do not fit
    /// into a packet.
    pub const fn check(&self, size: DataSize) -> Result<(), BudgetError> {
        let Self { process_bytes, clock_hz, idle_ns, cycle_ns, exchanges } = *self;
        if clock_hz == 0 || exchanges == 0 {
            return Err(BudgetError::NoExchange);
        }
        if process_bytes > size.bytes() {
            return Err(BudgetError::TooManyBytes { process_bytes, most: size.bytes() });
        }
        let (transfer_ns, needed_ns) = (self.transfer_ns(size), self.needed_ns(size));
        if needed_ns <= cycle_ns {
            return Ok(());
        }
        Err(BudgetError::CycleTooShort { size, clock_hz, transfer_ns, idle_ns, exchanges, needed_ns, cycle_ns })
    }

    /// Chooses the data segment size: [`COMFORTABLE_SIZE`], or more if the process data need more. If the cycle is too
    /// short for that, the smallest size that holds the process data.
    ///
    /// # Errors
    /// [`BudgetError`] with the calculation, if no packet holds the process data or the exchanges do not fit into the
    /// cycle.
    pub fn choose_size(&self) -> Result<DataSize, BudgetError> {
        let least = DataSize::new(self.process_bytes.max(DataSize::MIN.bytes())).unwrap_or(DataSize::MAX);
        [least.max(COMFORTABLE_SIZE), least]
            .into_iter()
            .find(|size| self.check(*size).is_ok())
            .map_or_else(|| self.check(least).map(|()| least), Ok)
    }
}

impl fmt::Display for BudgetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TooManyBytes { process_bytes, most } => {
                write!(
                    f,
                    "{process_bytes} bytes of process data do not fit into a packet, which holds {most}; map less"
                )
            }
            Self::NoExchange => f.write_str("a clock of 0 Hz or a cycle of 0 exchanges moves nothing; give both"),
            Self::CycleTooShort { size, clock_hz, transfer_ns, idle_ns, exchanges, needed_ns, cycle_ns } => write!(
                f,
                "a cycle of {} us cannot be held: {exchanges} exchange(s) of {} bytes at {} kHz take {} us each and \
                 {} us of idle time, together {} us; take a longer cycle, a faster clock, INT0, fewer process data or \
                 pipelined writes",
                cycle_ns / 1000,
                size.packet_len(),
                clock_hz / 1000,
                transfer_ns.div_ceil(1000),
                idle_ns.div_ceil(1000),
                needed_ns.div_ceil(1000),
            ),
        }
    }
}

impl core::error::Error for BudgetError {}
