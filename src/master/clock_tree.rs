//! The slaves with distributed clocks, the reference clock, and the propagation delays, which are computed from the
//! receive times of a frame at each slave.

use super::topology::{PORT_ORDER, Upstream, is_open};
use crate::ethercat::registers::{DlStatus, PORTS};
use crate::ethercat::{Command, SlaveSet};

/// When a slave with distributed clocks generates its SYNC signals: their cycle, offset and delay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SyncSignals {
    /// Value for registers 0x0980 (low byte) and 0x0981, which selects the SYNC signals. ESI files and EEPROMs call it
    /// AssignActivate.
    pub assign_activate: u16,
    /// The cycle of SYNC0, ns.
    pub cycle_ns: u32,
    /// The offset of SYNC0 from multiples of its cycle, ns.
    pub shift_ns: i32,
    /// The delay from SYNC0 to SYNC1, ns.
    pub sync1_ns: u32,
}

impl SyncSignals {
    /// Settings with SYNC0 alone.
    pub const fn sync0(cycle_ns: u32, shift_ns: i32) -> Self {
        Self { assign_activate: 0x0300, cycle_ns, shift_ns, sync1_ns: 0 }
    }
}

/// The clock that all distributed clocks follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReferenceClock {
    /// The clock of the first slave that has one. The master's clock has no influence on it.
    #[default]
    FirstSlave,
    /// The clock of the master. All slaves follow it, the first one with a clock, too.
    Master,
}

/// The position of a slave in the tree of cables, for the measurement of propagation delays.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) station: u16,
    pub(super) ports: DlStatus,
    pub(super) upstream: Option<Upstream>,
}

/// The receive times of one frame at a slave, in the slave's local time, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Passed {
    /// The receive times at ports 0 to 3.
    pub(super) ports: [u32; PORTS],
    /// The receive time at the processing unit.
    pub(super) unit: u64,
}

/// The slaves with distributed clocks, and the propagation delays to them.
#[derive(Clone, Debug, Default)]
pub(super) struct Clocks {
    /// The slaves that have a clock.
    pub(super) all: SlaveSet,
    /// The slaves whose clocks were set to the reference time: the master has written their offset and propagation
    /// delay.
    pub(super) set: SlaveSet,
    /// The slaves whose clocks have only 32 bits.
    pub(super) short: SlaveSet,
    pub(super) places: Vec<Place>,
    /// If the cables make a ring: the propagation delay of each slave, ns, measured while the ring was opened.
    pub(super) ring_delays: Option<Vec<u32>>,
    /// The newest time of the reference clock, ns.
    pub(super) time: u64,
}

impl Clocks {
    /// The slave with the reference clock: the first one that answers and whose clock is set.
    pub(super) fn reference(&self, missing: SlaveSet) -> Option<u8> {
        self.set.difference(missing).iter().next()
    }

    /// Marks a port as closed in the tree of cables: while the master measures delays, no frame leaves the slave by
    /// this port.
    pub(super) fn close(&mut self, Upstream { slave, port }: Upstream) {
        if let Some(place) = self.places.get_mut(usize::from(slave) - 1) {
            place.ports = place.ports.with_port(port.into(), true, true);
        }
    }

    pub(super) fn station(&self, slave: u8) -> Option<u16> {
        self.places.get(usize::from(slave).checked_sub(1)?).map(|place| place.station)
    }

    /// The station address of the slave with the reference clock.
    pub(super) fn reference_station(&self, missing: SlaveSet) -> Option<u16> {
        self.station(self.reference(missing)?)
    }

    /// Takes a time that was read from the reference clock, and extends it to 64 bits if that clock has only 32.
    pub(super) fn take_time(&mut self, sent: u64, missing: SlaveSet) {
        self.time = match self.reference(missing) {
            Some(slave) if self.short.contains(slave) => extended(sent as u32, self.time),
            _ => sent,
        };
    }
}

/// Extends a time of 32 bits to 64 bits. `near` is a time less than 2 s away.
pub(super) fn extended(time: u32, near: u64) -> u64 {
    near.wrapping_add_signed(time.wrapping_sub(near as u32).cast_signed().into())
}

/// Appends to `delays` the propagation delay from the first slave to each slave, ns; 0 for slaves without receive
/// times.
pub(super) fn put_delays(places: &[Place], passed: &[Option<Passed>], delays: &mut Vec<u32>) {
    for (n, place) in places.iter().enumerate() {
        delays.push(delay(places, passed, delays, n, place).unwrap_or(0));
    }
}

/// The propagation delay of slave `n` (from 0), computed from the delays of the slaves before it.
fn delay(places: &[Place], passed: &[Option<Passed>], delays: &[u32], n: usize, place: &Place) -> Option<u32> {
    let own = passed.get(n).copied()??;
    if !is_open(place.ports, 0) {
        // The slave is beyond the gap of an open ring: the frame has reached it from the other end, so its receive
        // times show no delay from the first slave.
        return None;
    }
    // Skip slaves without a clock on the way to the master.
    let mut upstream = place.upstream?;
    let (at, parent) = loop {
        let at = usize::from(upstream.slave).checked_sub(1).filter(|at| *at < n)?;
        if let Some(parent) = passed[at] {
            break (at, parent);
        }
        upstream = places[at].upstream?;
    };
    let open = |ports| PORT_ORDER.into_iter().filter(move |port| is_open(ports, *port));
    // The frame left the parent towards this branch when the parent received it at the open port before, in port order:
    // at port 0, or at the port by which the frame came back from the branch before.
    let before = open(places[at].ports).take_while(|port| *port != usize::from(upstream.port)).last().unwrap_or(0);
    let left = parent.ports[before];
    let around = parent.ports[usize::from(upstream.port)].wrapping_sub(left);
    let behind = open(place.ports).next_back().map_or(0, |last| own.ports[last].wrapping_sub(own.ports[0]));
    let way = around.saturating_sub(behind) / 2;
    Some(delays[at].wrapping_add(left.wrapping_sub(parent.ports[0])).wrapping_add(way))
}

/// The datagram of a cycle that distributes the reference time to all clocks.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClockDatagram {
    /// FRMW, or BWR for the master's own time.
    pub(super) command: Command,
    /// The station address of the slave with the reference clock; 0 for the master's own time.
    pub(super) station: u16,
    /// The newest time of the reference clock, or the master's time, ns.
    pub(super) time: u64,
}
