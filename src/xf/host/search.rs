//! Searches for the data segment size n and the beginning of a packet: bytes are clocked until packets are recognised,
//! and then up to the end of a packet.

use crate::ethercat::Ns;
use crate::xf::{DataSize, MAX_PACKET, Resync};

/// Number of bytes that are clocked at a time, followed by the idle time. `[OURS]` The length of the smallest packet:
/// the chip needs an idle time between packets, and gets one at least once per packet although the borders are unknown.
const CHUNK: usize = DataSize::MIN.packet_len();

/// The bytes sent during the search: no start word, so that the chip does not take them for a command.
static FILLER: [u8; MAX_PACKET] = [0; MAX_PACKET];

#[derive(Clone, Debug)]
pub(super) struct Search {
    reader: Resync,
    pushed: u64,
    given: u64,
    pub(super) since: Ns,
}

impl Search {
    pub(super) const fn new(since: Ns) -> Self {
        Self { reader: Resync::new(), pushed: 0, given: 0, since }
    }

    /// Number of bytes received so far.
    pub(super) const fn bytes(&self) -> u64 {
        self.pushed
    }

    /// The bytes to clock out next.
    pub(super) fn filler(&self) -> &'static [u8] {
        let len = self.reader.size().map_or(CHUNK, |size| size.packet_len() - self.held(size));
        &FILLER[..len.clamp(1, MAX_PACKET)]
    }

    /// Number of bytes received of the current packet; 0 means that the next byte is the first one of a packet.
    fn held(&self, size: DataSize) -> usize {
        ((self.pushed - self.reader.dropped() - self.given) % size.packet_len() as u64) as usize
    }

    /// Searches received bytes for the border between two packets. Returns the size of their data segments if `bytes` end at a
    /// border, so that the next byte that is received begins a packet.
    pub(super) fn take(&mut self, bytes: &[u8]) -> Option<DataSize> {
        let mut rest = bytes;
        while !rest.is_empty() {
            let taken = self.reader.push(rest);
            self.pushed += taken as u64;
            rest = &rest[taken..];
            while let Some(packet) = self.reader.next_packet() {
                self.given += packet.len() as u64;
            }
        }
        self.reader.size().filter(|size| self.given > 0 && self.held(*size) == 0)
    }
}
