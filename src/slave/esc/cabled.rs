//! A line of slave controllers that follows a [`Cable`]: scripts and tests inject faults through that handle, while frames
//! pass.

use super::scripted::Scripted;
use super::{Chain, DescriptionError, EscSettings, EscSlave, FrameFate, Predecessor};
use crate::ethercat::{CableEnd, Ns};
use crate::slave::Slave;
use crate::slave::cable::{self, Cable, Noise};

/// A slave cannot be put on a network, because no EEPROM content can be generated from its description.
#[derive(Debug, thiserror::Error)]
#[error("slave {slave} ({kind}) cannot be put on a network: {source}")]
pub struct UndescribedError {
    /// The number of the slave, from 1.
    pub slave: usize,
    /// The display name of the slave.
    pub kind: String,
    /// Why no EEPROM content can be generated.
    pub source: DescriptionError,
}

/// The drift of the crystal of slave `n` (from 0) of `count`, parts per billion: from `most` for the first slave evenly
/// down to `-most` for the last one.
fn drift_of(n: usize, count: usize, most: u32) -> i32 {
    let (steps, most) = (count.saturating_sub(1).max(1) as i64, i64::from(most));
    let drift = most - 2 * most * n as i64 / steps;
    drift.clamp(i32::MIN.into(), i32::MAX.into()) as i32
}

/// A line of slaves with faults: before each frame, and when time advances, it applies the faults that were set in its
/// [`Cable`], such as a cut or a silent slave.
pub struct CabledChain {
    chain: Chain,
    cable: Cable,
    /// The number of slaves in front of the cut, as last applied to `chain`. It is compared with the [`Cable`] to
    /// detect a change.
    reach: u8,
    /// The slaves that do not answer, one bit each, as last applied to `chain`. They are compared with the [`Cable`] to
    /// detect a change.
    silent: [u64; 4],
    /// Whether the first network card is connected to the first slave. There may still be a cut of the [`Cable`] between them.
    has_first: bool,
    /// Whether a second network card is connected to the last slave.
    is_ring: bool,
    /// `passed`: the frames that have passed the noisy cable section since the last one that was damaged there. `is_back_next`:
    /// whether the next damaged frame is damaged on its way back to the master instead of on its way out; the two alternate.
    passed: u16,
    is_back_next: bool,
}

impl CabledChain {
    /// A line of slaves, switched on at time 0.
    ///
    /// # Errors
    /// [`UndescribedError`]: a device does not define the content of its EEPROM.
    pub fn new(devices: Vec<Box<dyn Slave>>, cable: Cable) -> Result<Self, UndescribedError> {
        Self::with_drift(devices, cable, 0)
    }

    /// As [`Self::new`], with drifting crystals: the crystal of the first slave is `drift_ppb` parts per billion too
    /// fast, the crystal of the last slave is too slow by the same amount, and the others are evenly distributed in
    /// between.
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

    /// The cable, for injecting faults.
    pub const fn cable(&self) -> &Cable {
        &self.cable
    }

    /// The slave controllers in the line.
    pub const fn chain(&self) -> &Chain {
        &self.chain
    }

    /// The slave controllers in the line, for faults that [`Cable`] does not offer.
    pub const fn chain_mut(&mut self) -> &mut Chain {
        &mut self.chain
    }

    /// Puts each slave into a random state, as a previous master may have left it at `now`, see [`Predecessor`].
    pub fn leave(&mut self, predecessor: &mut Predecessor, now: Ns) {
        self.chain.leave(predecessor, now);
    }

    /// Sends a frame at `now` and changes it in place, see [`Chain::process`].
    pub fn process(&mut self, frame: &mut [u8], now: Ns) -> FrameFate {
        self.follow_cable(now);
        match self.cable.noise() {
            Some(noise) if self.is_damaged(noise) => self.damage(noise.slave, frame, now),
            _ => self.chain.process(frame, now),
        }
    }

    /// Counts a frame that passes the noisy cable section. Returns whether this frame is damaged.
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

    /// The number of slaves that frames from the first network card reach.
    const fn reached(&self) -> u8 {
        let last = self.chain.len() as u8;
        if self.reach < last { self.reach } else { last }
    }

    /// Sends a frame that is damaged in the cable section in front of `slave`, alternately on the way out and on the way
    /// back. The first slave that receives the damaged frame counts an invalid frame at that port; all later ones count a
    /// forwarded error, and no slave processes the datagrams. The frame returns to the master with a wrong check sequence,
    /// which is the same as a lost frame.
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
        // On its way back, the damaged frame comes in again at port 1 of every slave in front of the last one that it reaches,
        // and these slaves count it there. If the damage is on the way back, only the slaves in front of the damaged section
        // see it.
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

    /// Sends a frame from one end of the line, see [`Chain::process_from`].
    pub fn process_from(&mut self, end: CableEnd, frame: &mut [u8], now: Ns) -> (FrameFate, CableEnd) {
        if end == CableEnd::First && !self.is_ring {
            return (self.process(frame, now), end);
        }
        self.follow_cable(now);
        self.chain.process_from(end, frame, now)
    }

    /// Connects or disconnects the card in front of the first slave. A cut of the [`Cable`] is independent of this.
    pub fn connect_first(&mut self, is_connected: bool) {
        if is_connected != std::mem::replace(&mut self.has_first, is_connected) && !self.chain.is_empty() {
            self.chain.connect(0, is_connected && self.reach != 0);
        }
    }

    /// Connects or disconnects a second card at port 1 of the last slave.
    pub fn connect_second(&mut self, is_connected: bool) {
        let is_connected = is_connected && !self.chain.is_empty();
        if is_connected != std::mem::replace(&mut self.is_ring, is_connected) {
            self.chain.connect_second(is_connected.then(|| (self.chain.len() - 1, 1)));
        }
    }

    /// Advances the slaves to `now`.
    pub fn advance(&mut self, now: Ns) {
        self.follow_cable(now);
        for n in 0..self.chain.len() {
            self.chain.delay_sdo(n, self.cable.sdo_delay_ns(n as u8 + 1));
        }
        self.chain.advance(now);
    }

    /// Applies changes of the cable (cuts, lost power, silent slaves, faults inside devices) to the slaves.
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
