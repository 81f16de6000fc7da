//! Finds n and the beginning of a packet: bytes are clocked until packets show, and then up to the end of one.

use crate::ethercat::Ns;
use crate::xf::{DataSize, MAX_PACKET, Resync};

/// Bytes that are clocked at a time. `[OURS]` As many as the least packet has, so that the idle time behind them comes
/// at least once in each packet.
const CHUNK: usize = DataSize::MIN.packet_len();

/// What is sent meanwhile: no start word, so that the chip takes it for no command.
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

    /// Bytes that have come.
    pub(super) const fn bytes(&self) -> u64 {
        self.pushed
    }

    /// What is to be clocked out.
    pub(super) fn filler(&self) -> &'static [u8] {
        let len = self.reader.size().map_or(CHUNK, |size| size.packet_len() - self.held(size));
        &FILLER[..len.clamp(1, MAX_PACKET)]
    }

    /// Bytes of the packet that has begun. 0 means that the next byte is the first one of a packet.
    fn held(&self, size: DataSize) -> usize {
        ((self.pushed - self.reader.dropped() - self.given) % size.packet_len() as u64) as usize
    }

    /// Takes what came back, and gives n once the next byte is the first one of a packet.
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
