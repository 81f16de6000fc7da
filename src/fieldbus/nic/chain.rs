//! Simulated slave controllers in place of the network behind a network card, for programs and tests of
//! [`NicBus`](super::NicBus) without a card. Time is virtual: it passes only while the bus waits.

use std::collections::VecDeque;

use super::{CardPair, NicWires};
use crate::ethercat::{CableEnd, FRAME_LEN_MAX, Ns};
use crate::master::{FrameBuffer, Wire, WireDown};
use crate::slave::Slave;
use crate::slave::esc::{CabledChain, FrameFate, Predecessor, UndescribedError};
use crate::slave::handle::SimHandle;

/// The time that a card takes to send a frame and to deliver its answer, without the propagation delay of the cable, ns.
/// \[OURS]
const CARD_NS: Ns = 20_000;
/// The maximum step in which time advances in the slaves, ns. \[OURS]
const STEP_NS: Ns = 1_000_000;

/// The number of preallocated frame buffers: four for each of the 32 frames that the master may have in flight, because
/// a ring also sends a probe with each frame and may forward the frame.
const FRAMES: usize = 4 * 32;

/// An answer frame on its way back to a network card, which receives it at the time `at`.
struct Returning {
    at: Ns,
    frame: Vec<u8>,
}

/// A line of simulated slaves behind a simulated network card. The clock advances only during waits.
pub struct ChainWires {
    slaves: CabledChain,
    handle: SimHandle,
    now: Ns,
    /// The answer frames on their way back to the first end and to the last end of the line, the oldest first.
    returning: [VecDeque<Returning>; 2],
    /// Unused frame buffers, so that a frame needs no allocation.
    spare: Vec<Vec<u8>>,
}

impl ChainWires {
    /// Connects these slaves in a line and switches them on at time 0. With `handle` the caller cuts cables, switches
    /// slaves off and on and causes other faults while the slaves run.
    ///
    /// # Errors
    /// [`UndescribedError`]: the EEPROM of a device cannot be written, because the device does not describe its
    /// content.
    pub fn new(devices: Vec<Box<dyn Slave>>, handle: SimHandle) -> Result<Self, UndescribedError> {
        Self::with_drift(devices, handle, 0)
    }

    /// Like [`Self::new`], with crystals that are up to `drift_ppb` parts per billion too fast or too slow, as described at
    /// [`CabledChain::with_drift`].
    ///
    /// # Errors
    /// As with [`Self::new`].
    pub fn with_drift(
        devices: Vec<Box<dyn Slave>>,
        handle: SimHandle,
        drift_ppb: u32,
    ) -> Result<Self, UndescribedError> {
        Ok(Self::on_cable(CabledChain::with_drift(devices, handle.cable().clone(), drift_ppb)?, handle))
    }

    /// Makes the wires for slaves that are already on a cable. The cable has to be the one that `handle` controls.
    pub fn on_cable(slaves: CabledChain, handle: SimHandle) -> Self {
        let spare = (0..FRAMES).map(|_| Vec::with_capacity(FRAME_LEN_MAX)).collect();
        let returning = [(); 2].map(|()| VecDeque::with_capacity(FRAMES));
        let mut wires = Self { slaves, handle, now: 0, returning, spare };
        wires.publish_shafts();
        wires
    }

    /// The simulated slaves with their cable.
    pub const fn slaves(&self) -> &CabledChain {
        &self.slaves
    }

    /// Simulates that another master has used the slaves until now and then stops: each slave is left in a state in
    /// which that master may leave it.
    pub fn leave(&mut self, predecessor: &mut Predecessor) {
        self.slaves.leave(predecessor, self.now);
    }

    /// Connects a second network card behind the last slave, which makes a ring, or disconnects it.
    pub fn connect_second(&mut self, is_connected: bool) {
        self.slaves.connect_second(is_connected);
    }

    fn publish_shafts(&mut self) {
        let chain = self.slaves.chain();
        let shafts = (0..chain.len()).map(|n| chain.slave(n).device().shafts());
        self.handle.publish(self.now, shafts);
    }
}

/// The index of a cable end in arrays that have one entry for each end.
const fn place(end: CableEnd) -> usize {
    match end {
        CableEnd::First => 0,
        CableEnd::Last => 1,
    }
}

impl Wire for ChainWires {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        CardPair::send(self, CableEnd::First, frame)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        CardPair::receive(self, CableEnd::First, buffer)
    }
}

impl CardPair for ChainWires {
    fn send(&mut self, end: CableEnd, frame: &[u8]) -> Result<(), WireDown> {
        let mut buffer = self.spare.pop().unwrap_or_default();
        buffer.clear();
        buffer.extend_from_slice(frame);
        match self.slaves.process_from(end, &mut buffer, self.now) {
            (FrameFate::Returned(at), end) => {
                self.returning[place(end)].push_back(Returning { at: at + CARD_NS, frame: buffer });
            }
            (FrameFate::Destroyed | FrameFate::Lost, _) => self.spare.push(buffer),
        }
        Ok(())
    }

    fn receive(&mut self, end: CableEnd, buffer: &mut FrameBuffer) -> Option<usize> {
        let Returning { frame, .. } = self.returning[place(end)].pop_front_if(|first| first.at <= self.now)?;
        let len = frame.len();
        buffer[..len].copy_from_slice(&frame);
        self.spare.push(frame);
        Some(len)
    }

    fn now(&self) -> Ns {
        self.now
    }

    fn wait(&mut self, until: Ns) {
        let firsts = self.returning.iter().filter_map(VecDeque::front).map(|first| first.at);
        let next = firsts.min().map_or(until, |first| first.min(until)).max(self.now);
        while self.now < next {
            self.now = next.min(self.now + STEP_NS);
            self.slaves.advance(self.now);
        }
        self.publish_shafts();
    }

    fn is_real_time(&self) -> bool {
        false
    }
}

impl NicWires for ChainWires {
    fn now(&self) -> Ns {
        CardPair::now(self)
    }

    fn wait(&mut self, until: Ns) {
        CardPair::wait(self, until);
    }

    fn is_real_time(&self) -> bool {
        CardPair::is_real_time(self)
    }
}
