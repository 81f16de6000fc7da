//! The wire between the chip's master and the slave controllers.

use std::collections::VecDeque;

use crate::ethercat::Ns;
use crate::master::{FrameBuffer, Wire, WireDown};
use crate::slave::esc::{CabledChain, FrameFate};

/// Slave controllers on a wire. `[OURS]` A frame passes all slaves within the call with which the master sends it. Each
/// slave processes the frame with the simulated time at which a real frame would pass it, but for the master the round
/// trip takes no time: it can receive the frame at once.
pub(super) struct ChainWire {
    pub(super) slaves: CabledChain,
    pub(super) now: Ns,
    /// Frames that have come back and that the master has not received yet.
    back: VecDeque<Vec<u8>>,
    /// Free frame buffers, kept for reuse so that sending does not allocate.
    spare: Vec<Vec<u8>>,
}

impl ChainWire {
    pub(super) const fn new(slaves: CabledChain) -> Self {
        Self { slaves, now: 0, back: VecDeque::new(), spare: Vec::new() }
    }

    /// Lets time pass until `now`.
    pub(super) fn advance(&mut self, now: Ns) {
        self.now = now;
        self.slaves.advance(now);
    }
}

impl Wire for ChainWire {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        let mut buffer = self.spare.pop().unwrap_or_default();
        buffer.clear();
        buffer.extend_from_slice(frame);
        match self.slaves.process(&mut buffer, self.now) {
            FrameFate::Returned(_) => self.back.push_back(buffer),
            FrameFate::Destroyed | FrameFate::Lost => self.spare.push(buffer),
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        let frame = self.back.pop_front()?;
        let len = frame.len();
        buffer[..len].copy_from_slice(&frame);
        self.spare.push(frame);
        Some(len)
    }
}
