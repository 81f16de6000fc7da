//! The chip as a stream of bytes, as on SPI: for each byte to the chip there is one from it.

use super::Chip;
use super::network::SlaveNetwork;
use crate::ethercat::Ns;
use crate::xf::MAX_PACKET;

/// A chip that is accessed as a stream of bytes.
///
/// The chip only counts bytes: every 32 + n bytes are a packet (n is the size of the data segment), whatever position
/// the host takes for the beginning of a packet. A host that is out of step sends invalid packets, each of which is a
/// framing error. The host finds the beginning of packets again where an end word is followed by a start word in the
/// bytes that it receives.
pub struct ChipPort<N> {
    chip: Chip<N>,
    /// Number of bytes of the present packet that were transferred.
    at: usize,
    /// Whether the chip was ready when the present packet began. If not, the packet is lost.
    is_ready: bool,
    /// The length of the present packet, bytes.
    len: usize,
    outgoing: [u8; MAX_PACKET],
    incoming: [u8; MAX_PACKET],
}

impl<N: SlaveNetwork> ChipPort<N> {
    /// A port to this chip, at the beginning of a packet.
    pub const fn new(chip: Chip<N>) -> Self {
        Self { chip, at: 0, is_ready: false, len: 0, outgoing: [0; MAX_PACKET], incoming: [0; MAX_PACKET] }
    }

    /// The chip behind the port.
    pub const fn chip(&self) -> &Chip<N> {
        &self.chip
    }

    /// The chip, to let time pass and to use its pins.
    pub const fn chip_mut(&mut self) -> &mut Chip<N> {
        &mut self.chip
    }

    /// Transfers bytes both ways at `now`: sends `to_chip` and receives the same number into `from_chip`. If their lengths
    /// differ, as many bytes as the shorter one has are transferred. Returns that number.
    pub fn transfer(&mut self, now: Ns, to_chip: &[u8], from_chip: &mut [u8]) -> usize {
        self.chip.run_until(now);
        let passing = to_chip.len().min(from_chip.len());
        let mut passed = 0;
        while passed < passing {
            if self.at == 0 {
                self.begin();
            }
            let n = (self.len - self.at).min(passing - passed);
            from_chip[passed..][..n].copy_from_slice(&self.outgoing[self.at..][..n]);
            self.incoming[self.at..][..n].copy_from_slice(&to_chip[passed..][..n]);
            self.at += n;
            passed += n;
            if self.at == self.len {
                self.end();
            }
        }
        passed
    }

    /// Releases the chip's reset line at `now`: the chip restarts, and the next byte begins a packet.
    pub fn reset(&mut self, now: Ns) {
        self.chip.reset(now);
        self.at = 0;
    }

    fn begin(&mut self) {
        self.is_ready = self.chip.is_ready();
        self.len = self.chip.outgoing_len(self.is_ready);
        self.chip.put_outgoing(self.is_ready, &mut self.outgoing[..self.len]);
    }

    fn end(&mut self) {
        self.at = 0;
        if self.is_ready {
            self.chip.take(&self.incoming[..self.len]);
        }
    }
}
