//! What an exchange costs in time, and the n that process data need.

use core::fmt;

use crate::ethercat::Ns;
use crate::xf::DataSize;

/// The least n that is chosen if the cycle has the time for it. `[OURS]` 112, what an ECM-XF starts with:
/// PDO_CONFIG_SET needs 112 bytes.
pub const COMFORTABLE_SIZE: DataSize = DataSize::MANUAL;

/// What is known about a cycle, from which n is chosen.
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
    /// Bytes of process data in one packet: of the RxPDOs or of the TxPDOs, whichever are more; at most 1408.
    pub process_bytes: usize,
    /// The clock of SPI in Hz. The chip takes 96 MHz at most (XF EN 147).
    pub clock_hz: u32,
    /// The idle time behind each exchange in nanoseconds; with INT0 what the chip takes on the average.
    pub idle_ns: Ns,
    /// The cycle that is to be held, in nanoseconds.
    pub cycle_ns: Ns,
    /// How many exchanges a cycle has: 1 with [`pipelined_writes`](super::HostConfig::pipelined_writes) and no other
    /// command in each cycle, else 2 or more.
    pub exchanges: u32,
}

/// Why a cycle cannot be held. What to do about it: a longer cycle, a faster clock, less idle time by INT0, fewer
/// process data, or pipelined writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BudgetError {
    /// No packet holds so many process data.
    TooManyBytes {
        /// Bytes of process data.
        process_bytes: usize,
        /// n: the one that there is, or 1408, the largest.
        most: usize,
    },
    /// There is no clock, or no exchange.
    NoExchange,
    /// The exchanges of a cycle take longer than the cycle.
    CycleTooShort {
        /// The n that the process data need.
        size: DataSize,
        /// The clock of SPI in Hz.
        clock_hz: u32,
        /// How long the bytes of one packet take, in nanoseconds.
        transfer_ns: Ns,
        /// The idle time behind it in nanoseconds.
        idle_ns: Ns,
        /// How many exchanges a cycle has.
        exchanges: u32,
        /// All of them with their idle time, in nanoseconds.
        needed_ns: Ns,
        /// The cycle that was to be held, in nanoseconds.
        cycle_ns: Ns,
    },
}

impl Budget {
    /// How long the bytes of one packet take, in nanoseconds, rounded up; `Ns::MAX` without a clock. 1056 bytes take
    /// 352 us at 24 MHz.
    pub const fn transfer_ns(&self, size: DataSize) -> Ns {
        if self.clock_hz == 0 {
            return Ns::MAX;
        }
        // 1440 bytes are 1.2e13 bits * ns/s, far below 2^64.
        (size.packet_len() as u64 * 8 * 1_000_000_000).div_ceil(self.clock_hz as u64)
    }

    /// How long the exchanges of one cycle take with this n, with the idle time behind each, in nanoseconds.
    pub const fn needed_ns(&self, size: DataSize) -> Ns {
        self.transfer_ns(size).saturating_add(self.idle_ns).saturating_mul(self.exchanges as u64)
    }

    /// Whether the exchanges of a cycle with this n fit into it.
    ///
    /// # Errors
    /// They do not, or the process data do not fit into the packet; the error has the sum.
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

    /// The n to use: [`COMFORTABLE_SIZE`], or as much more as the process data need. If only less fits into the cycle,
    /// the least that holds the process data.
    ///
    /// # Errors
    /// No packet holds the process data, or the exchanges do not fit into the cycle; the error has the sum.
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
