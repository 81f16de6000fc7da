//! The clocks of the slaves as the master knows them: who has one, whose time they follow, and from when a frame has passed each
//! slave how long the way to it is.

use super::topology::{PORT_ORDER, Upstream, is_open};
use crate::ethercat::registers::{DlStatus, PORTS};
use crate::ethercat::{Command, SlaveSet};

/// The SYNC signals of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SyncSignals {
    /// What goes into registers 0x0980 (low byte) and 0x0981: which signals there are. ESI files and EEPROMs call it
    /// AssignActivate.
    pub assign_activate: u16,
    /// The cycle of SYNC0, ns.
    pub cycle_ns: u32,
    /// How much later than at a multiple of the cycle SYNC0 comes, ns.
    pub shift_ns: i32,
    /// How much later than SYNC0 SYNC1 comes, ns.
    pub sync1_ns: u32,
}

impl SyncSignals {
    /// SYNC0 alone.
    pub const fn sync0(cycle_ns: u32, shift_ns: i32) -> Self {
        Self { assign_activate: 0x0300, cycle_ns, shift_ns, sync1_ns: 0 }
    }
}

/// Whose time all clocks follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReferenceClock {
    /// That of the first slave with a clock, whatever the master's says.
    #[default]
    FirstSlave,
    /// That of the master, which the first slave with a clock follows like all others.
    Master,
}

/// A slave as the measurement of delays sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) station: u16,
    pub(super) ports: DlStatus,
    pub(super) upstream: Option<Upstream>,
}

/// When a frame has passed a slave, in its local time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Passed {
    /// Ports 0 to 3.
    pub(super) ports: [u32; PORTS],
    /// The processing unit.
    pub(super) unit: u64,
}

/// The slaves whose clocks follow the reference, and how far they are away.
#[derive(Clone, Debug, Default)]
pub(super) struct Clocks {
    /// The slaves that have a clock.
    pub(super) all: SlaveSet,
    /// Those that have been set.
    pub(super) set: SlaveSet,
    /// The slaves whose clocks have 32 bits only.
    pub(super) short: SlaveSet,
    pub(super) places: Vec<Place>,
    /// The cables make a ring: how long the way to each slave is was measured when it was opened for that, ns.
    pub(super) ring_delays: Option<Vec<u32>>,
    /// The time that the reference had last.
    pub(super) time: u64,
}

impl Clocks {
    /// The slave with the reference clock: the first one that answers and has been set.
    pub(super) fn reference(&self, missing: SlaveSet) -> Option<u8> {
        self.set.difference(missing).iter().next()
    }

    /// No frame leaves a slave by that port while delays are measured.
    pub(super) fn close(&mut self, Upstream { slave, port }: Upstream) {
        if let Some(place) = self.places.get_mut(usize::from(slave) - 1) {
            place.ports = place.ports.with_port(port.into(), true, true);
        }
    }

    pub(super) fn station(&self, slave: u8) -> Option<u16> {
        self.places.get(usize::from(slave).checked_sub(1)?).map(|place| place.station)
    }

    /// The reference and its station.
    pub(super) fn reference_station(&self, missing: SlaveSet) -> Option<u16> {
        self.station(self.reference(missing)?)
    }

    /// Takes the time that the reference has sent.
    pub(super) fn take_time(&mut self, sent: u64, missing: SlaveSet) {
        self.time = match self.reference(missing) {
            Some(slave) if self.short.contains(slave) => {
                let passed = (sent as u32).wrapping_sub(self.time as u32);
                self.time.wrapping_add_signed(passed.cast_signed().into())
            }
            _ => sent,
        };
    }
}

/// Puts into `delays` how long a frame takes from the first slave to each one, ns; 0 for slaves without times.
pub(super) fn put_delays(places: &[Place], passed: &[Option<Passed>], delays: &mut Vec<u32>) {
    for (n, place) in places.iter().enumerate() {
        delays.push(delay(places, passed, delays, n, place).unwrap_or(0));
    }
}

/// The delay of a slave from those of the slaves before it.
fn delay(places: &[Place], passed: &[Option<Passed>], delays: &[u32], n: usize, place: &Place) -> Option<u32> {
    let own = passed.get(n).copied()??;
    if !is_open(place.ports, 0) {
        // It is behind the gap of a ring, and the frame has come to it from the other end.
        return None;
    }
    // Through slaves without a clock.
    let mut upstream = place.upstream?;
    let (at, parent) = loop {
        let at = usize::from(upstream.slave).checked_sub(1).filter(|at| *at < n)?;
        if let Some(parent) = passed[at] {
            break (at, parent);
        }
        upstream = places[at].upstream?;
    };
    let open = |ports| PORT_ORDER.into_iter().filter(move |port| is_open(ports, *port));
    // When the frame left the parent for the branch with this slave: it was at port 0, or came back from the branch before.
    let before = open(places[at].ports).take_while(|port| *port != usize::from(upstream.port)).last().unwrap_or(0);
    let left = parent.ports[before];
    let around = parent.ports[usize::from(upstream.port)].wrapping_sub(left);
    let behind = open(place.ports).next_back().map_or(0, |last| own.ports[last].wrapping_sub(own.ports[0]));
    let way = around.saturating_sub(behind) / 2;
    Some(delays[at].wrapping_add(left.wrapping_sub(parent.ports[0])).wrapping_add(way))
}

/// The datagram of a cycle that brings the time to all clocks.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClockDatagram {
    /// FRMW, or BWR for the master's own time.
    pub(super) command: Command,
    /// The station with the reference clock; 0 for the master's own time.
    pub(super) station: u16,
    /// The time that the reference had last, or the master's.
    pub(super) time: u64,
}
