//! What a user may want to change about the master.

use crate::ethercat::Ns;

/// The settings of a master. Times are in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The source address of its frames. Bit 1 of the first byte should be 0: slaves set it, and by it the master knows frames
    /// that have passed one.
    pub source: [u8; 6],
    /// \[OURS] How long a frame may take to come back; then it is lost.
    pub frame_timeout_ns: Ns,
    /// \[OURS] How often a datagram that harms nothing if it is done twice is sent at most, if nothing comes back.
    pub tries: u8,
    /// \[OURS] How long the index of a lost frame is not used again, so that a late answer is known as one.
    pub index_rest_ns: Ns,
    /// \[OURS] How often the master looks for slaves that have gone or left their state, and for mail that it has not asked for.
    pub watch_ns: Ns,
    /// \[OURS] The longest frame that is sent beside the cyclic ones, bytes. One datagram is sent, however long it is.
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
