//! What a user may want to change about the driver, with its defaults.

use crate::ethercat::Ns;
use crate::xf::request::FIFO_ENTRIES;
use crate::xf::{Coverages, DataSize};

const US: Ns = 1_000;
const MS: Ns = 1_000_000;
const S: Ns = 1_000_000_000;

/// How the driver knows that the chip is ready for the next packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pacing {
    /// It leaves [`HostConfig::idle_ns`] behind each exchange.
    #[default]
    Idle,
    /// It waits for the edge of INT0, which [`Host::ready`](super::Host::ready) reports. While packets are searched,
    /// and after an answer that says "not ready", it also leaves the idle time.
    Int0,
}

/// The configuration of a [`Host`](super::Host).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostConfig {
    /// The n that the chip has, if it is known; `None`, the default: it is found. If no answers come with the size
    /// given here, it is searched as well.
    pub size: Option<DataSize>,
    /// The n that the chip shall have, as [`Budget::choose_size`](super::Budget::choose_size) gives it; the chip is set
    /// to it at the start. `None`, the default: it keeps what it has, as an ECM-XFU has to.
    pub wanted_size: Option<DataSize>,
    /// What a CRC-32 covers; `None`, the default: it is found by trying, and if nothing fits the chip is set to the fixed word.
    pub coverages: Option<Coverages>,
    /// Idle time or INT0; idle time by default.
    pub pacing: Pacing,
    /// The idle time behind an exchange in nanoseconds; 150 us by default (XF EN 1706).
    pub idle_ns: Ns,
    /// The longest idle time. `[OURS]` Each answer "not ready" doubles the time up to this, 5 ms by default, and each
    /// other answer halves it again.
    pub idle_max_ns: Ns,
    /// How often the header is asked for while there is nothing else to do, in nanoseconds; 10 ms by default.
    pub poll_ns: Ns,
    /// How often it is asked for while a non-immediate command runs, in nanoseconds; 1 ms by default.
    pub busy_poll_ns: Ns,
    /// Whether a write of process data may go out before the answer to the one before is there. With `false`, the
    /// default, each write takes two exchanges, and none is ever lost while packets get through at all. With `true` it
    /// takes one; a write that the chip did not accept then is dropped, since a later one has gone out already, and
    /// reported.
    pub pipelined_writes: bool,
    /// Entries of the RxFIFO as the chip starts: [`FIFO_ENTRIES`] by default (XF EN 1262). FIFO_SET_RX_CNT and
    /// FIFO_GET_RX_CNT change what the driver takes for it.
    pub rx_entries: u8,
    /// The FIFO stays as it is: the start neither switches it off nor empties it. For a host that looks at a chip on which
    /// a machine runs. `false` by default: the usual start of an application does both (OBS).
    pub keep_fifo: bool,
    /// After so many damaged answers in a row the beginning of packets is searched anew; 8 by default.
    pub resync_after: u32,
    /// After so many waits for INT0 in vain, one after the other, the driver gives up; 3 by default.
    pub int0_misses: u32,
    /// How long the driver waits for what.
    pub deadlines: Deadlines,
}

/// How long the driver waits for what, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deadlines {
    /// For packets in the stream of bytes; 3 s by default, since a chip takes up to 1 s to start (OBS).
    pub search_ns: Ns,
    /// For the whole start, the search included; 10 s by default.
    pub start_ns: Ns,
    /// For an edge of INT0; 10 ms by default.
    pub int0_ns: Ns,
    /// For the answer to a packet, all its repetitions included; 100 ms by default.
    pub answer_ns: Ns,
    /// For the end of a non-immediate command; 30 s by default. [`Host::submit_within`](super::Host::submit_within)
    /// sets another time for one command.
    pub busy_ns: Ns,
    /// Until a command that waits in its queue is sent, and until the result of one that has ended is read; 60 s by
    /// default.
    pub queue_ns: Ns,
    /// After SPI_RECONFIG_OP nothing is sent for so long; 100 ms by default (OBS).
    pub resize_ns: Ns,
}

impl Default for HostConfig {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Default for Deadlines {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl HostConfig {
    /// The defaults.
    pub const DEFAULT: Self = Self {
        size: None,
        wanted_size: None,
        coverages: None,
        pacing: Pacing::Idle,
        idle_ns: 150 * US,
        idle_max_ns: 5 * MS,
        poll_ns: 10 * MS,
        busy_poll_ns: MS,
        pipelined_writes: false,
        rx_entries: FIFO_ENTRIES,
        keep_fifo: false,
        resync_after: 8,
        int0_misses: 3,
        deadlines: Deadlines::DEFAULT,
    };
}

impl Deadlines {
    /// The defaults.
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
