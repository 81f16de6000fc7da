//! The chip as a stream of bytes both ways, as SPI has it: for each byte to the chip there is one from it.

use super::Chip;
use super::network::Network;
use crate::ethercat::Ns;
use crate::xf::MAX_PACKET;

/// A chip behind its bytes.
///
/// The chip counts bytes: after each n + 32 of them a packet ends and the next one begins, wherever the host believes
/// that it does. A host that is out of step sends packets that are none, each of which is a framing error, and finds
/// the step again where end word and start word follow each other in what it receives.
pub struct ChipPort<N> {
    chip: Chip<N>,
    /// Bytes of the present packet that have passed.
    at: usize,
    /// Whether the chip was ready when it began.
    is_ready: bool,
    /// Its length.
    len: usize,
    outgoing: [u8; MAX_PACKET],
    incoming: [u8; MAX_PACKET],
}

impl<N: Network> ChipPort<N> {
    /// A port to this chip, at the beginning of a packet.
    pub const fn new(chip: Chip<N>) -> Self {
        Self { chip, at: 0, is_ready: false, len: 0, outgoing: [0; MAX_PACKET], incoming: [0; MAX_PACKET] }
    }

    /// The chip.
    pub const fn chip(&self) -> &Chip<N> {
        &self.chip
    }

    /// The chip, to let time pass and to use its pins.
    pub const fn chip_mut(&mut self) -> &mut Chip<N> {
        &mut self.chip
    }

    /// Clocks bytes both ways at `now`: all of `to_chip`, of any number, and as many into `from_chip`. Where the two
    /// differ in length the shorter one counts. How many bytes passed.
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

    /// The chip's reset line was low, and is high from `now` on: all is as after power-on, and the next byte begins a packet.
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
