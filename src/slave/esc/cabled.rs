//! Slave controllers in a line, and the handle by which scripts and tests reach them while frames pass.

use super::scripted::Scripted;
use super::{Chain, DescriptionError, EscSettings, EscSlave, FrameFate, Predecessor};
use crate::ethercat::{CableEnd, Ns};
use crate::slave::Slave;
use crate::slave::cable::{self, Cable, Noise};

/// A slave in a line cannot be put on a network: its EEPROM cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("slave {slave} ({kind}) cannot be put on a network: {source}")]
pub struct UndescribedError {
    /// Which one, from 1.
    pub slave: usize,
    /// Its name.
    pub kind: String,
    /// Why.
    pub source: DescriptionError,
}

/// The drift of the crystal of a slave (from 0), parts per billion.
fn drift_of(n: usize, count: usize, most: u32) -> i32 {
    let (steps, most) = (count.saturating_sub(1).max(1) as i64, i64::from(most));
    let drift = most - 2 * most * n as i64 / steps;
    drift.clamp(i32::MIN.into(), i32::MAX.into()) as i32
}

/// Slaves in a line, to which happens what its [`Cable`] is told.
pub struct CabledChain {
    chain: Chain,
    cable: Cable,
    /// How many slaves the cable reaches.
    reach: u8,
    /// The slaves that do not answer.
    silent: [u64; 4],
    /// The cable from the card to the first slave is whole, as far as the card knows.
    has_first: bool,
    /// The cable from the last slave to a second card is whole.
    is_ring: bool,
    /// How many frames have passed a cable that damages some, and whether the next one is damaged on its way back.
    passed: u16,
    is_back_next: bool,
}

impl CabledChain {
    /// Slaves in a line that are switched on at time 0.
    ///
    /// # Errors
    /// [`UndescribedError`]: a device does not say what belongs into its EEPROM.
    pub fn new(devices: Vec<Box<dyn Slave>>, cable: Cable) -> Result<Self, UndescribedError> {
        Self::with_drift(devices, cable, 0)
    }

    /// The same slaves with crystals that are up to `drift_ppb` parts per billion too fast or too slow: the first one is too fast
    /// by that much, the last one too slow, and the others lie evenly between them.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_drift(devices: Vec<Box<dyn Slave>>, cable: Cable, drift_ppb: u32) -> Result<Self, UndescribedError> {
        let count = devices.len();
        let on_cable = |(n, device): (usize, Box<dyn Slave>)| {
            let kind = device.name().to_owned();
            let device = Box::new(Scripted::new(device, cable.clone(), n as u8 + 1));
            let settings = EscSettings { drift_ppb: drift_of(n, count, drift_ppb), ..device.controller_settings() };
            let slave = EscSlave::describe(device, settings, 0);
            slave.map_err(|source| UndescribedError { slave: n + 1, kind, source })
        };
        let slaves = devices.into_iter().enumerate().map(on_cable).collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            silent: [0; 4],
            chain: Chain::line(slaves),
            reach: cable.reach(),
            has_first: true,
            is_ring: false,
            cable,
            passed: 0,
            is_back_next: false,
        })
    }

    /// The cable, for faults.
    pub const fn cable(&self) -> &Cable {
        &self.cable
    }

    /// The slaves.
    pub const fn chain(&self) -> &Chain {
        &self.chain
    }

    /// The slaves, to cause something in them that the cable knows nothing of.
    pub const fn chain_mut(&mut self) -> &mut Chain {
        &mut self.chain
    }

    /// Each slave is left as that other master leaves it, which ends at `now`.
    pub fn leave(&mut self, predecessor: &mut Predecessor, now: Ns) {
        self.chain.leave(predecessor, now);
    }

    /// A frame goes out at `now` and is changed in place, as [`Chain::process`] says.
    pub fn process(&mut self, frame: &mut [u8], now: Ns) -> FrameFate {
        self.follow_cable(now);
        match self.cable.noise() {
            Some(noise) if self.is_damaged(noise) => self.damage(noise.slave, frame, now),
            _ => self.chain.process(frame, now),
        }
    }

    /// Whether a frame is the one of many that the cable damages.
    fn is_damaged(&mut self, noise: Noise) -> bool {
        if !(1..=self.reached()).contains(&noise.slave) {
            return false;
        }
        self.passed += 1;
        let is_damaged = self.passed >= noise.one_of.get();
        if is_damaged {
            self.passed = 0;
        }
        is_damaged
    }

    /// How many slaves frames come to.
    const fn reached(&self) -> u8 {
        let last = self.chain.len() as u8;
        if self.reach < last { self.reach } else { last }
    }

    /// A frame passes the cable before that slave, which damages it, by turns on the way out and on the way back. Who gets it
    /// first counts an invalid frame at that port, all behind it a forwarded error, and nobody takes its datagrams; it comes
    /// back to the master with a wrong check sequence, which is as if it did not.
    fn damage(&mut self, slave: u8, frame: &mut [u8], now: Ns) -> FrameFate {
        const IN: usize = 0;
        const BACK: usize = 1;
        let (before, reached) = (usize::from(slave) - 1, usize::from(self.reached()));
        let is_back = self.is_back_next;
        self.is_back_next = !is_back;
        if is_back {
            self.chain.process(frame, now);
        } else {
            let answers = |n: &usize| !cable::has(&self.silent, *n as u8 + 1);
            let behind: Vec<usize> = (before..reached).filter(answers).collect();
            behind.iter().for_each(|n| self.chain.silence(*n, true));
            self.chain.process(frame, now);
            behind.iter().for_each(|n| self.chain.silence(*n, false));
            self.chain.slave_mut(before).controller_mut().note_invalid_frame(IN);
            (before + 1..reached).for_each(|n| self.chain.slave_mut(n).controller_mut().note_forwarded_error(IN));
        }
        // All slaves but the last one get it once more, from the one behind.
        let back = if is_back { before } else { reached - 1 };
        for n in (0..back).rev() {
            let controller = self.chain.slave_mut(n).controller_mut();
            if is_back && n + 1 == before {
                controller.note_invalid_frame(BACK);
            } else {
                controller.note_forwarded_error(BACK);
            }
        }
        FrameFate::Lost
    }

    /// A frame goes out at that end, as [`Chain::process_from`] says.
    pub fn process_from(&mut self, end: CableEnd, frame: &mut [u8], now: Ns) -> (FrameFate, CableEnd) {
        if end == CableEnd::First && !self.is_ring {
            return (self.process(frame, now), end);
        }
        self.follow_cable(now);
        self.chain.process_from(end, frame, now)
    }

    /// Connects the card before the first slave, or takes it away. The [`Cable`] may be cut there, too.
    pub fn connect_first(&mut self, is_connected: bool) {
        if is_connected != std::mem::replace(&mut self.has_first, is_connected) && !self.chain.is_empty() {
            self.chain.connect(0, is_connected && self.reach != 0);
        }
    }

    /// Connects a second card to port 1 of the last slave, or takes it away.
    pub fn connect_second(&mut self, is_connected: bool) {
        let is_connected = is_connected && !self.chain.is_empty();
        if is_connected != std::mem::replace(&mut self.is_ring, is_connected) {
            self.chain.connect_second(is_connected.then(|| (self.chain.len() - 1, 1)));
        }
    }

    /// Time passes up to `now`.
    pub fn advance(&mut self, now: Ns) {
        self.follow_cable(now);
        for n in 0..self.chain.len() {
            self.chain.delay_sdo(n, self.cable.sdo_delay_ns(n as u8 + 1));
        }
        self.chain.advance(now);
    }

    /// What the cable was told happens to the slaves.
    fn follow_cable(&mut self, now: Ns) {
        let chain = &mut self.chain;
        let place = |slave: u8| usize::from(slave) - 1;
        let last = chain.len() as u8;
        let reach = self.cable.reach();
        if reach != std::mem::replace(&mut self.reach, reach) {
            let has_first = self.has_first;
            let is_whole = |place: usize| place != usize::from(reach) && (place > 0 || has_first);
            (1..=last).for_each(|slave| chain.connect(place(slave), is_whole(place(slave))));
        }
        let powered_off = self.cable.take_all_powered_off();
        if powered_off != [0; 4] {
            for slave in (1..=last).filter(|slave| cable::has(&powered_off, *slave)) {
                chain.power(place(slave), false, now);
                chain.power(place(slave), true, now);
            }
        }
        let silent = self.cable.silent();
        if silent != std::mem::replace(&mut self.silent, silent) {
            (1..=last).for_each(|slave| chain.silence(place(slave), cable::has(&silent, slave)));
        }
        self.cable.take_faults(|slave, fault| {
            if (1..=last).contains(&slave) {
                chain.slave_mut(place(slave)).device_mut().apply_fault(fault);
            }
        });
    }
}
