//! [`Settings`]: addresses, timeouts and intervals of the master.

use crate::ethercat::Ns;

/// The settings of a master. Times are in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The source address of the master's frames. Bit 1 of the first byte should be 0: slaves set it, and by it the
    /// master recognises frames that have passed a slave.
    pub source: [u8; 6],
    /// \[OURS] The timeout of a frame; a frame that comes back later counts as lost.
    pub frame_timeout_ns: Ns,
    /// \[OURS] How often a datagram is sent at most if no frame comes back; 0 counts as 1. Only for datagrams that a
    /// slave may execute twice, such as accesses to registers. Requests to mailboxes and
    /// [`Master::datagram`](super::Master::datagram) are not repeated in this way.
    pub tries: u8,
    /// \[OURS] How long the index of a lost frame is not reused, so that a late answer is recognised as such.
    pub index_rest_ns: Ns,
    /// \[OURS] The interval in which the master checks whether slaves are missing or have left their AL state, and whether mailboxes
    /// have messages that nobody has requested (emergencies).
    pub watch_ns: Ns,
    /// \[OURS] The longest frame with acyclic datagrams while cycles run, bytes. A single longer datagram is still
    /// sent.
    pub acyclic_bytes_max: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            source: [0x10; 6],
            frame_timeout_ns: 5_000_000,
            tries: 3,
            index_rest_ns: 100_000_000,
            watch_ns: 5_000_000,
            acyclic_bytes_max: 600,
        }
    }
}
