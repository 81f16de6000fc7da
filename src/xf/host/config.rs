//! The settings of the driver, with their defaults.

use crate::ethercat::Ns;
use crate::xf::request::FIFO_ENTRIES;
use crate::xf::{CrcCoverages, DataSize};

const US: Ns = 1_000;
const MS: Ns = 1_000_000;
const S: Ns = 1_000_000_000;

/// How the driver recognises that the chip is ready for the next packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HostPacing {
    /// The driver leaves an idle time of [`HostConfig::idle_ns`] after each exchange.
    #[default]
    Idle,
    /// The driver waits for the edge of INT0, which [`Host::ready`](super::Host::ready) reports. While it searches for
    /// packets, and after an answer "not ready", it leaves the idle time as well.
    Int0,
}

/// The settings of a [`Host`](super::Host): what is known of the chip, how exchanges are paced, and all timeouts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostConfig {
    /// The chip's n (size of the data segment), if known. `None`, the default: the driver searches for it. If no
    /// answers come with the given size, the driver searches as well.
    pub size: Option<DataSize>,
    /// The data segment size n to which the driver sets the chip at the start, as chosen by
    /// [`Budget::choose_size`](super::Budget::choose_size). `None`, the default: the chip keeps its n, as is necessary
    /// for an ECM-XFU, whose n is fixed at 992.
    pub wanted_size: Option<DataSize>,
    /// Which bytes a CRC-32 covers. `None`, the default: the driver finds out by trying, and if nothing fits sets the
    /// chip to the fixed check word.
    pub coverages: Option<CrcCoverages>,
    /// Whether the driver paces its exchanges by idle time, the default, or by INT0.
    pub pacing: HostPacing,
    /// The idle time after an exchange in nanoseconds; 150 us by default (XF EN 1706).
    pub idle_ns: Ns,
    /// The longest idle time in nanoseconds; 5 ms by default. `[OURS]` Each answer "not ready" doubles the idle time up
    /// to this limit, and each other answer halves it again.
    pub idle_max_ns: Ns,
    /// Interval at which the driver polls the header while it has nothing else to do, in nanoseconds; 10 ms by default.
    pub poll_ns: Ns,
    /// Interval at which the driver polls the header while a non-immediate command runs, in nanoseconds; 1 ms by
    /// default.
    pub busy_poll_ns: Ns,
    /// Whether process data may be written before the answer to the previous write has come. With `false`, the default,
    /// each write takes two exchanges, and no write is lost as long as any packets get through. With `true` each write
    /// takes one exchange; a write that the chip did not accept is reported and not retried, since a later one has
    /// already been sent.
    pub pipelined_writes: bool,
    /// Number of entries of the RxFIFO when the chip starts: [`FIFO_ENTRIES`] by default (XF EN 1262). FIFO_SET_RX_CNT
    /// and FIFO_GET_RX_CNT update the driver's value.
    pub rx_entries: u8,
    /// Leaves the FIFO as it is: the start neither switches it off nor empties it. This is for a host that observes a
    /// chip while a machine runs. `false` by default: the usual start of an application does both (OBS).
    pub keep_fifo: bool,
    /// Number of damaged answers in a row after which the driver searches for the beginning of packets again; 8 by
    /// default.
    pub resync_after: u32,
    /// Number of timeouts of INT0 in a row after which the driver stops; 3 by default.
    pub int0_misses: u32,
    /// How long the driver waits for packets, answers and commands before it gives up.
    pub timeouts: Timeouts,
}

/// The driver's timeouts, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeouts {
    /// Timeout of the search for packets in the stream of bytes; 3 s by default, since a chip takes up to 1 s to start
    /// (OBS).
    pub search_ns: Ns,
    /// Timeout of the chip's whole start, including the search for packets; 10 s by default.
    pub start_ns: Ns,
    /// Timeout of the wait for an edge of INT0; 10 ms by default.
    pub int0_ns: Ns,
    /// Timeout of the answer to a packet, including all its retries; 100 ms by default. It takes effect only after four
    /// copies of the packet were sent: a host that was suspended has given the chip no chance to answer.
    pub answer_ns: Ns,
    /// Timeout of a non-immediate command in the chip; 30 s by default.
    /// [`Host::submit_within`](super::Host::submit_within) sets another time for one command.
    pub busy_ns: Ns,
    /// Timeout of a queued command until it is sent, and of an ended command until its result is read from the chip; 60
    /// s by default.
    pub queue_ns: Ns,
    /// Pause after SPI_RECONFIG_OP in which nothing is sent; 100 ms by default (OBS).
    pub resize_ns: Ns,
}

impl Default for HostConfig {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Default for Timeouts {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl HostConfig {
    /// The defaults, which the comments of [`HostConfig`]'s fields explain.
    pub const DEFAULT: Self = Self {
        size: None,
        wanted_size: None,
        coverages: None,
        pacing: HostPacing::Idle,
        idle_ns: 150 * US,
        idle_max_ns: 5 * MS,
        poll_ns: 10 * MS,
        busy_poll_ns: MS,
        pipelined_writes: false,
        rx_entries: FIFO_ENTRIES,
        keep_fifo: false,
        resync_after: 8,
        int0_misses: 3,
        timeouts: Timeouts::DEFAULT,
    };
}

impl Timeouts {
    /// The defaults, which the comments of [`Timeouts`]'s fields explain.
    pub const DEFAULT: Self = Self {
        search_ns: 3 * S,
        start_ns: 10 * S,
        int0_ns: 10 * MS,
        answer_ns: 100 * MS,
        busy_ns: 30 * S,
        queue_ns: 60 * S,
        resize_ns: 100 * MS,
    };
}
