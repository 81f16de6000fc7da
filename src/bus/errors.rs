//! The error counters of slave controllers, registers 0x0300 to 0x0313, and which cable is bad.
//!
//! A frame that is damaged on a cable has a wrong check sequence. The slave that gets it first counts an invalid frame at that port
//! and marks the frame, so that all slaves behind count a forwarded error, and none of them an invalid frame. So an invalid frame
//! is blamed on the cable at that port, and a forwarded error on no one.

use super::{BusError, FoundSlave, Network};
use crate::ethercat::registers::{FORWARDED_ERRORS, LOST_LINKS, PDI_ERRORS, PORTS, PROCESSING_UNIT_ERRORS, RX_ERRORS};

/// A counter that has come so far counts no further.
pub const COUNTER_MAX: u8 = u8::MAX;
/// How many bytes the counters have.
const LEN: usize = LOST_LINKS as usize + PORTS - RX_ERRORS as usize;

/// The counters of a port. Each stops at [`COUNTER_MAX`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PortErrors {
    /// Frames that came in with a wrong check sequence and that no slave before has marked.
    pub invalid: u8,
    /// Errors of the physical layer, some of them between frames.
    pub physical: u8,
    /// Frames that a slave before has marked.
    pub forwarded: u8,
    /// How often the link was lost.
    pub lost_links: u8,
}

/// The counters of a slave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SlaveErrors {
    /// The slave, from 1.
    pub slave: u8,
    /// Those of its ports.
    pub ports: [PortErrors; PORTS],
    /// Frames whose datagrams do not fit into them.
    pub processing_unit: u8,
    /// Wrong accesses by the slave's own controller.
    pub pdi: u8,
}

impl SlaveErrors {
    fn decode(slave: u8, bytes: &[u8; LEN]) -> Self {
        let at = |register: u16, n: usize| bytes[usize::from(register - RX_ERRORS) + n];
        let port = |port: usize| PortErrors {
            invalid: at(RX_ERRORS, 2 * port),
            physical: at(RX_ERRORS, 2 * port + 1),
            forwarded: at(FORWARDED_ERRORS, port),
            lost_links: at(LOST_LINKS, port),
        };
        Self {
            slave,
            ports: std::array::from_fn(port),
            processing_unit: at(PROCESSING_UNIT_ERRORS, 0),
            pdi: at(PDI_ERRORS, 0),
        }
    }

    /// What has been counted since `before`. A counter that was cleared in between counts from 0, and one at
    /// [`COUNTER_MAX`] may have missed some.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        let more = |now: u8, before: u8| now.checked_sub(before).unwrap_or(now);
        let port = |port: usize| {
            let (now, before) = (self.ports[port], before.ports[port]);
            PortErrors {
                invalid: more(now.invalid, before.invalid),
                physical: more(now.physical, before.physical),
                forwarded: more(now.forwarded, before.forwarded),
                lost_links: more(now.lost_links, before.lost_links),
            }
        };
        Self {
            slave: self.slave,
            ports: std::array::from_fn(port),
            processing_unit: more(self.processing_unit, before.processing_unit),
            pdi: more(self.pdi, before.pdi),
        }
    }
}

/// Reads the counters of a slave.
///
/// # Errors
/// [`BusError::Register`]
pub fn read_one(network: &mut dyn Network, slave: u8) -> Result<SlaveErrors, BusError> {
    let mut bytes = [0; LEN];
    network.read(slave, RX_ERRORS, &mut bytes)?;
    Ok(SlaveErrors::decode(slave, &bytes))
}

/// Reads the counters of all slaves.
///
/// # Errors
/// [`BusError::Register`]
pub fn read(network: &mut dyn Network, slaves: &[FoundSlave]) -> Result<Vec<SlaveErrors>, BusError> {
    slaves.iter().map(|found| read_one(network, found.slave)).collect()
}

/// Clears the counters of all slaves.
///
/// # Errors
/// [`BusError::Register`]
pub fn clear(network: &mut dyn Network, slaves: &[FoundSlave]) -> Result<(), BusError> {
    for found in slaves {
        // A write to one of a group clears the group.
        for register in [RX_ERRORS, PROCESSING_UNIT_ERRORS, PDI_ERRORS, LOST_LINKS] {
            network.write(found.slave, register, &[0])?;
        }
    }
    Ok(())
}

/// One end of a cable: a port of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct End {
    /// The slave, from 1.
    pub slave: u8,
    /// The port, 0..=3.
    pub port: u8,
}

/// Where something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// On a cable, or in its plugs or ports.
    Cable {
        /// Its end towards the master; `None`: the master itself.
        near: Option<End>,
        /// Its other end; `None`: no slave is there now.
        far: Option<End>,
    },
    /// In a slave: its own controller makes wrong accesses.
    Slave(u8),
    /// In the master: its frames are wrong.
    Master,
}

/// Something that is wrong, by the counters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trouble {
    /// Where.
    pub place: Place,
    /// The counters of the port at the near end of a cable.
    pub near: PortErrors,
    /// Those at the far end.
    pub far: PortErrors,
    /// How often, if it is no cable.
    pub count: u8,
}

impl PortErrors {
    /// Whether they say something of the cable at this port.
    const fn blames(&self) -> bool {
        self.invalid > 0 || self.physical > 0 || self.lost_links > 0
    }
}

/// The cable at a port, by the ends that it has.
fn cable_at(slaves: &[FoundSlave], end: End) -> (Option<End>, Option<End>) {
    let of = |slave: u8| slaves.iter().find(|found| found.slave == slave);
    if end.port == 0 {
        let upstream = of(end.slave).and_then(|found| found.upstream);
        return (upstream.map(|up| End { slave: up.slave, port: up.port }), Some(end));
    }
    let is_there = |found: &&FoundSlave| found.upstream.is_some_and(|up| (up.slave, up.port) == (end.slave, end.port));
    (Some(end), slaves.iter().find(is_there).map(|found| End { slave: found.slave, port: 0 }))
}

/// What is wrong, in the order of the slaves. Each cable is told of once, with the counters of both its ends.
pub fn judge(slaves: &[FoundSlave], errors: &[SlaveErrors]) -> Vec<Trouble> {
    let mut troubles: Vec<Trouble> = Vec::new();
    let counters = |end: Option<End>| {
        let found = end.and_then(|end| Some((errors.iter().find(|of| of.slave == end.slave)?, end.port)));
        found.map_or(PortErrors::default(), |(of, port)| of.ports[usize::from(port)])
    };
    for of in errors {
        for (port, errors) in (0..).zip(&of.ports) {
            let (near, far) = cable_at(slaves, End { slave: of.slave, port });
            let place = Place::Cable { near, far };
            if errors.blames() && troubles.iter().all(|trouble| trouble.place != place) {
                troubles.push(Trouble { place, near: counters(near), far: counters(far), count: 0 });
            }
        }
        if of.pdi > 0 {
            let none = PortErrors::default();
            troubles.push(Trouble { place: Place::Slave(of.slave), near: none, far: none, count: of.pdi });
        }
    }
    let wrong_frames = errors.iter().map(|of| of.processing_unit).max().unwrap_or(0);
    if wrong_frames > 0 {
        let none = PortErrors::default();
        troubles.push(Trouble { place: Place::Master, near: none, far: none, count: wrong_frames });
    }
    troubles
}
