//! The error counters of slave controllers, registers 0x0300 to 0x0313, and which cable is bad.
//!
//! A frame that is damaged on a cable has a wrong check sequence. The slave that gets it first counts an invalid frame
//! at that port and marks the frame, so that all slaves after it count a forwarded error and no invalid frame. An
//! invalid frame therefore points to the cable at that port; a forwarded error points to no cable.

use super::{BusError, FoundSlave, Network};
use crate::ethercat::registers::{FORWARDED_ERRORS, LOST_LINKS, PDI_ERRORS, PORTS, PROCESSING_UNIT_ERRORS, RX_ERRORS};

/// The value at which a counter stops counting.
pub const COUNTER_MAX: u8 = u8::MAX;
/// The length of the block of counter registers, bytes.
const LEN: usize = LOST_LINKS as usize + PORTS - RX_ERRORS as usize;

/// The error counters of one port of a slave. Each stops at [`COUNTER_MAX`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PortErrors {
    /// Frames that arrived with a wrong check sequence and without the mark of an earlier slave.
    pub invalid: u8,
    /// Errors of the physical layer, in frames and between frames.
    pub physical: u8,
    /// Damaged frames that an earlier slave has marked already.
    pub forwarded: u8,
    /// The number of times the port lost its link.
    pub lost_links: u8,
}

/// The error counters of a slave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SlaveErrors {
    /// The slave, from 1.
    pub slave: u8,
    /// The counters of its ports 0 to 3.
    pub ports: [PortErrors; PORTS],
    /// Frames with a wrong structure, such as a datagram that runs beyond the end of its frame (ECAT processing unit
    /// errors). The master has sent them that way.
    pub processing_unit: u8,
    /// Wrong accesses by the microcontroller of the slave (PDI errors).
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

    /// Returns how much each counter has risen since the reading `before`. A counter that is lower than before was
    /// cleared meanwhile, and counts with its whole value. A counter at [`COUNTER_MAX`] may have missed errors.
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
/// [`BusError::Register`]: a slave does not answer.
pub fn read_one(network: &mut dyn Network, slave: u8) -> Result<SlaveErrors, BusError> {
    let mut bytes = [0; LEN];
    network.read(slave, RX_ERRORS, &mut bytes)?;
    Ok(SlaveErrors::decode(slave, &bytes))
}

/// Reads the counters of all slaves.
///
/// # Errors
/// [`BusError::Register`]: a slave does not answer.
pub fn read(network: &mut dyn Network, slaves: &[FoundSlave]) -> Result<Vec<SlaveErrors>, BusError> {
    slaves.iter().map(|found| read_one(network, found.slave)).collect()
}

/// Clears the counters of all slaves.
///
/// # Errors
/// [`BusError::Register`]: a slave does not answer.
pub fn clear(network: &mut dyn Network, slaves: &[FoundSlave]) -> Result<(), BusError> {
    for found in slaves {
        // The error registers form four groups. Writing to any register of a group clears all counters of the group.
        for register in [RX_ERRORS, PROCESSING_UNIT_ERRORS, PDI_ERRORS, LOST_LINKS] {
            network.write(found.slave, register, &[0])?;
        }
    }
    Ok(())
}

/// One end of a cable: a port of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CablePort {
    /// The slave, from 1.
    pub slave: u8,
    /// The port, 0 to 3.
    pub port: u8,
}

/// The part of the network that causes errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProblemPlace {
    /// A cable, its plugs, or the ports at its ends.
    Cable {
        /// The end towards the master; `None` if that is the master itself.
        near: Option<CablePort>,
        /// The other end; `None` if no slave is connected there now.
        far: Option<CablePort>,
    },
    /// A slave: its microcontroller makes wrong accesses.
    Slave(u8),
    /// The master: it sends wrong frames.
    Master,
}

/// A problem that the counters show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Where the problem is.
    pub place: ProblemPlace,
    /// The counters of the port at the near end of the cable; all 0 if that end is the master, or if the place is not a
    /// cable.
    pub near: PortErrors,
    /// The counters of the port at the far end of the cable; all 0 if no slave is connected there, or if the place is not
    /// a cable.
    pub far: PortErrors,
    /// The number of errors, if the place is not a cable.
    pub count: u8,
}

impl PortErrors {
    /// Whether these counters point to the cable at this port. Forwarded errors do not: another port has counted their
    /// frames as invalid.
    const fn points_to_cable(&self) -> bool {
        self.invalid > 0 || self.physical > 0 || self.lost_links > 0
    }
}

/// The near and the far end of the cable at a port.
fn cable_at(slaves: &[FoundSlave], end: CablePort) -> (Option<CablePort>, Option<CablePort>) {
    let of = |slave: u8| slaves.iter().find(|found| found.slave == slave);
    if end.port == 0 {
        let upstream = of(end.slave).and_then(|found| found.upstream);
        return (upstream.map(|up| CablePort { slave: up.slave, port: up.port }), Some(end));
    }
    let is_there = |found: &&FoundSlave| found.upstream.is_some_and(|up| (up.slave, up.port) == (end.slave, end.port));
    (Some(end), slaves.iter().find(is_there).map(|found| CablePort { slave: found.slave, port: 0 }))
}

/// Finds the cables, slaves or the master that cause the counted errors: cables and slaves in network order, the master
/// last. Each cable is listed once, with the counters of both its ends.
pub fn judge(slaves: &[FoundSlave], errors: &[SlaveErrors]) -> Vec<Problem> {
    let mut problems: Vec<Problem> = Vec::new();
    let counters = |end: Option<CablePort>| {
        let found = end.and_then(|end| Some((errors.iter().find(|of| of.slave == end.slave)?, end.port)));
        found.map_or(PortErrors::default(), |(of, port)| of.ports[usize::from(port)])
    };
    for of in errors {
        for (port, errors) in (0..).zip(&of.ports) {
            let (near, far) = cable_at(slaves, CablePort { slave: of.slave, port });
            let place = ProblemPlace::Cable { near, far };
            if errors.points_to_cable() && problems.iter().all(|problem| problem.place != place) {
                problems.push(Problem { place, near: counters(near), far: counters(far), count: 0 });
            }
        }
        if of.pdi > 0 {
            let none = PortErrors::default();
            problems.push(Problem { place: ProblemPlace::Slave(of.slave), near: none, far: none, count: of.pdi });
        }
    }
    let wrong_frames = errors.iter().map(|of| of.processing_unit).max().unwrap_or(0);
    if wrong_frames > 0 {
        let none = PortErrors::default();
        problems.push(Problem { place: ProblemPlace::Master, near: none, far: none, count: wrong_frames });
    }
    problems
}
