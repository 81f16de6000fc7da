//! An independent line of EtherCAT slaves, in virtual time. It is written from the register layout and the protocols alone
//! (ETG.1000.4 and .6), with plain bytes and numbers, and uses nothing of `ecmsk` but the traits by which a master gets its
//! wire. It shares nothing with the models in `src/slave/`, which have the same author as the master. Each oddity is a field.
//!
//! - `esc.rs`: datagrams and registers; `managers.rs`: sync managers and FMMUs; `states.rs`: the AL state machine and its refusals
//! - `eeprom.rs`, `sii.rs`: access to an EEPROM, with its times and errors; its content
//! - `mailbox.rs`, `coe.rs`, `information.rs`, `foe.rs`: the mailbox, SDO, the list of objects, files
//! - `clock.rs`: receive times and the clock that follows the reference
//! - `device.rs`: what is behind a controller

mod clock;
mod coe;
mod device;
mod eeprom;
mod esc;
mod foe;
mod information;
mod mailbox;
mod managers;
pub mod sii;
mod states;

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use ecmsk::fieldbus::nic::NicWires;
use ecmsk::master::{FrameBuffer, Wire, WireDown};

pub use clock::Clock;
pub use coe::{Coe, number};
pub use device::{Device, Drive, coupler, drive, drive_objects, drive_of, terminal};
pub use eeprom::{Beyond, Eeprom};
pub use esc::OddSlave;
pub use foe::Foe;
pub use mailbox::{Change, Mailbox};
pub use states::States;

/// Nanoseconds.
pub type Ns = u64;

/// Delay of a frame from one slave to the next one, ns.
pub const HOP_NS: Ns = 300;
/// Time that a card takes for a frame and its answer, ns.
const CARD_NS: Ns = 15_000;
/// Slaves that get no frame run on in such steps, ns.
const STEP_NS: Ns = 1_000_000;

struct Line {
    slaves: Vec<OddSlave>,
    now: Ns,
    /// Frames on their way back, with their times of arrival.
    returning: VecDeque<(Ns, Vec<u8>)>,
    keeps_source: bool,
    /// The number of slaves that frames reach.
    reached: usize,
}

/// Slaves in a line, and the wire to them. Clones share the slaves.
#[derive(Clone)]
pub struct OddLine(Arc<Mutex<Line>>);

impl OddLine {
    /// These slaves, which are switched on now.
    pub fn new(slaves: impl IntoIterator<Item = OddSlave>) -> Self {
        let slaves: Vec<OddSlave> = slaves.into_iter().collect();
        let reached = slaves.len();
        let mut line = Line { slaves, now: STEP_NS, returning: VecDeque::new(), keeps_source: false, reached };
        line.show_ports();
        Self(Arc::new(Mutex::new(line)))
    }

    /// Slaves that do not mark frames as passed: the source address comes back as it was sent.
    pub fn keeping_the_source(self) -> Self {
        self.line(|line| line.keeps_source = true);
        self
    }

    fn line<R>(&self, action: impl FnOnce(&mut Line) -> R) -> R {
        action(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs `action` on a slave, counted from 1.
    pub fn slave<R>(&self, slave: usize, action: impl FnOnce(&mut OddSlave) -> R) -> R {
        self.line(|line| action(&mut line.slaves[slave - 1]))
    }

    /// So many slaves are reached from now on.
    pub fn reach(&self, slaves: usize) {
        self.line(|line| {
            line.reached = slaves;
            line.show_ports();
        });
    }
}

impl Line {
    /// Sets register 0x0110 of all slaves: which ports have a link, and which are open.
    fn show_ports(&mut self) {
        let last = self.reached.wrapping_sub(1);
        for (n, slave) in self.slaves.iter_mut().enumerate() {
            let status: u16 = match (n == last, slave.is_swapped) {
                (false, _) => 0x5A31,
                (true, false) => 0x5611,
                // Port 0 has no link, and port 1 is where frames come in.
                (true, true) => 0x5921,
            };
            slave.memory[0x0110..0x0112].copy_from_slice(&status.to_le_bytes());
        }
    }

    /// In which order the slaves work on a frame, and the delay of each. A slave whose IN and OUT are swapped gets the
    /// frame by port 1, passes it on by port 0, and works on it when it comes back there.
    fn visits(&self) -> Vec<(usize, Ns, [Ns; 2])> {
        let hop = |n: usize| HOP_NS * (n as Ns + 1);
        let back = |n: usize| hop(n) + 2 * HOP_NS * (self.reached - 1 - n) as Ns;
        let is_swapped = |n: &usize| self.slaves[*n].is_swapped;
        let forth = (0..self.reached).filter(|n| !is_swapped(n)).map(|n| (n, hop(n), [hop(n), back(n)]));
        let home = (0..self.reached).rev().filter(is_swapped).map(|n| (n, back(n), [back(n), hop(n)]));
        forth.chain(home).collect()
    }

    fn process(&mut self, frame: &mut [u8]) {
        let datagrams = datagrams(frame);
        if !self.keeps_source {
            frame[6] |= 2;
        }
        for (n, after, ports) in self.visits() {
            let now = self.now;
            let slave = &mut self.slaves[n];
            slave.begin_frame(now + after, ports.map(|port| now + port));
            for (at, len) in &datagrams {
                let (header, rest) = frame[*at..].split_at_mut(10);
                let (data, rest) = rest.split_at_mut(*len);
                let command = header[0];
                let address: &mut [u8; 4] = (&mut header[2..6]).try_into().expect("four bytes");
                let more = slave.datagram(command, address, data);
                let counter = u16::from_le_bytes([rest[0], rest[1]]).wrapping_add(more);
                rest[..2].copy_from_slice(&counter.to_le_bytes());
            }
            slave.end_frame();
        }
    }

    fn advance(&mut self, now: Ns) {
        self.now = now;
        self.slaves.iter_mut().for_each(|slave| slave.advance(now));
    }
}

/// Where the datagrams of a frame begin, and how many bytes of data they have.
fn datagrams(frame: &[u8]) -> Vec<(usize, usize)> {
    let word = |at: usize| frame.get(at..at + 2).map(|two| u16::from_le_bytes([two[0], two[1]]));
    let mut found = Vec::new();
    if word(12) != Some(0xA488) {
        return found;
    }
    let end = 16 + usize::from(word(14).unwrap_or(0) & 0x07FF);
    let mut at = 16;
    while let Some(flags) = word(at + 6) {
        let len = usize::from(flags & 0x07FF);
        if at + 12 + len > end.min(frame.len()) {
            break;
        }
        found.push((at, len));
        at += 12 + len;
        if flags & 0x8000 == 0 {
            break;
        }
    }
    found
}

impl Wire for OddLine {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        self.line(|line| {
            if line.reached == 0 {
                return;
            }
            let mut frame = frame.to_vec();
            line.process(&mut frame);
            let at = line.now + CARD_NS + 2 * HOP_NS * line.reached as Ns;
            line.returning.push_back((at, frame));
        });
        Ok(())
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        let frame = self.line(|line| {
            let now = line.now;
            line.returning.pop_front_if(|(at, _)| *at <= now).map(|(_, frame)| frame)
        })?;
        buffer[..frame.len()].copy_from_slice(&frame);
        Some(frame.len())
    }
}

impl NicWires for OddLine {
    fn now(&self) -> Ns {
        self.line(|line| line.now)
    }

    fn wait(&mut self, until: Ns) {
        self.line(|line| {
            let first = line.returning.front().map_or(until, |(at, _)| *at);
            let next = first.min(until).max(line.now);
            while line.now < next {
                let now = next.min(line.now + STEP_NS);
                line.advance(now);
            }
        });
    }

    fn is_real_time(&self) -> bool {
        false
    }
}
