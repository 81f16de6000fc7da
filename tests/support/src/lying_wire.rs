//! A wire that changes datagrams of process data on their way back, including working counters.

use std::sync::{Arc, Mutex, PoisonError};

use ecmsk::ethercat::{Command, DatagramMut, FRAME_HEADER_LEN, Ns};
use ecmsk::fieldbus::nic::NicWires;
use ecmsk::master::{FrameBuffer, Wire, WireDown};

/// A datagram on its way back.
pub struct Answer<'a> {
    pub command: Command,
    pub address: u32,
    /// Its data as they were sent.
    pub sent: &'a [u8],
    /// Its data now.
    pub data: &'a mut [u8],
    /// The working counter as the slaves have left it.
    pub counter: u16,
    /// The value added to the working counter, which wraps.
    pub count: u16,
}

impl Answer<'_> {
    /// Where these bytes of the logical memory are in the datagram, if it is one of process data that has them.
    pub fn at(&self, logical: u32, len: usize) -> Option<usize> {
        let is_logical = matches!(self.command, Command::Lrw | Command::Lrd | Command::Lwr);
        let at = usize::try_from(logical.checked_sub(self.address)?).ok()?;
        (is_logical && at + len <= self.data.len()).then_some(at)
    }

    /// Makes the answer look as if a slave had not sent these inputs.
    pub fn silence(&mut self, logical: u32, len: usize) {
        if let Some(at) = self.at(logical, len).filter(|_| self.command != Command::Lwr && self.counter > 0) {
            self.data[at..at + len].copy_from_slice(&self.sent[at..at + len]);
            self.count = self.count.wrapping_sub(1);
        }
    }
}

/// The change of each datagram.
type Lie = Box<dyn FnMut(&mut Answer<'_>) + Send>;

/// The changes that a wire makes, which a test may replace at any time; clones share them.
#[derive(Clone, Default)]
pub struct Lies(Arc<Mutex<Option<Lie>>>);

impl Lies {
    /// Applies this change from now on.
    pub fn tell(&self, lie: impl FnMut(&mut Answer<'_>) + Send + 'static) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(lie));
    }

    /// Ends all changes.
    pub fn end(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// Changes the answer to the frame `sent`.
    pub fn change(&self, sent: &[u8], frame: &mut [u8]) {
        let mut lie = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(lie) = lie.as_mut() else { return };
        let (_, mut rest) = frame.split_at_mut(FRAME_HEADER_LEN);
        let mut at = FRAME_HEADER_LEN;
        while let Ok((mut datagram, next)) = DatagramMut::split(rest) {
            let header = datagram.header();
            let (begin, len) = (at + 10, datagram.data.len());
            let sent = &sent[begin..begin + len];
            let (command, address) = (header.command, header.address);
            let counter = datagram.working_counter();
            let mut answer = Answer { command, address, sent, data: datagram.data, counter, count: 0 };
            lie(&mut answer);
            let count = answer.count;
            datagram.count(count);
            at = begin + len + 2;
            if !header.more {
                break;
            }
            rest = next;
        }
    }
}

/// Wires with such changes.
pub struct LyingWires<W> {
    wires: W,
    lies: Lies,
    /// The frame that was sent last with each index.
    sent: Vec<Vec<u8>>,
}

impl<W> LyingWires<W> {
    /// These wires with the changes of `lies`.
    pub fn new(wires: W, lies: Lies) -> Self {
        Self { wires, lies, sent: vec![Vec::new(); 256] }
    }
}

/// The index of the first datagram.
fn index(frame: &[u8]) -> usize {
    frame.get(FRAME_HEADER_LEN + 1).copied().unwrap_or(0).into()
}

impl<W: Wire> Wire for LyingWires<W> {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        let kept = &mut self.sent[index(frame)];
        kept.clear();
        kept.extend_from_slice(frame);
        self.wires.send(frame)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        let len = self.wires.receive(buffer)?;
        let sent = &self.sent[index(&buffer[..len])];
        if sent.len() == len {
            self.lies.change(sent, &mut buffer[..len]);
        }
        Some(len)
    }
}

impl<W: NicWires> NicWires for LyingWires<W> {
    fn now(&self) -> Ns {
        self.wires.now()
    }

    fn wait(&mut self, until: Ns) {
        self.wires.wait(until);
    }

    fn is_real_time(&self) -> bool {
        self.wires.is_real_time()
    }
}
