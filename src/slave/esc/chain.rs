//! Slaves on a cable: a frame goes through all of them and comes back.
//!
//! The cable is a tree. A frame leaves a slave by port 3, then 1, then 2, and comes back by port 0; a port that is closed
//! is passed by. A second card at the last slave makes it a ring. Time is that of one clock for the whole network, which each slave has a copy of that drifts.

use super::passing::Passing;
use super::place::Place;
use super::route::{Exit, Route, Slaves, Visit};
use super::{EscSlave, Predecessor};
use crate::ethercat::registers::{DL_CONTROL, DlControl, PORTS};
use crate::ethercat::{CableEnd, Frame, Ns, mark_as_passed};
use crate::slave::plant::{SIDE_BY_SIDE, follow_side_by_side};

/// \[OURS] How long a frame takes from one slave to the next one unless it is set, ns: a cable of some metres and two ports.
pub const HOP_NS: Ns = 310;

/// What has become of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameFate {
    /// It comes back at that time, where it has gone out or at the other end of a ring.
    Returned(Ns),
    /// A slave has destroyed it, because it is not of EtherCAT.
    Destroyed,
    /// It is gone: no slave is reached, or a port without a link is open.
    Lost,
}

/// A network of slaves.
#[derive(Default)]
pub struct Chain {
    places: Vec<Place>,
    /// The place and the port to which a second card is connected.
    ring: Option<(usize, usize)>,
    /// The ways of frames from the first end and from the last one.
    routes: [Route; 2],
    /// The datagrams of the frame that passes. Kept for its room.
    passing: Passing,
}

impl Chain {
    /// Slaves in a line, each at port 1 of the one before.
    pub fn line(slaves: impl IntoIterator<Item = EscSlave>) -> Self {
        let mut chain = Self::default();
        for slave in slaves {
            match chain.places.len().checked_sub(1) {
                None => chain.add_first(slave),
                Some(last) => {
                    chain.add(slave, last, 1);
                }
            }
        }
        chain
    }

    fn add_first(&mut self, slave: EscSlave) {
        self.push(slave, None);
    }

    /// Adds a slave at a port, 1 to 3, of another one; its number. If a slave is there already, that stays.
    ///
    /// # Panics
    /// If there is no slave `parent`, or the port is none of 1 to 3.
    pub fn add(&mut self, slave: EscSlave, parent: usize, port: usize) -> usize {
        assert!((1..PORTS).contains(&port), "slaves are connected to ports 1 to 3");
        let place = self.places.len();
        let at = self.places[parent].children[port].get_or_insert(place);
        if *at == place {
            self.push(slave, Some((parent, port)));
        }
        place
    }

    fn push(&mut self, slave: EscSlave, parent: Option<(usize, usize)>) {
        let children = [None; PORTS];
        let (is_connected, is_powered, is_silent) = (true, true, false);
        self.places.push(Place { slave, children, parent, hop_ns: HOP_NS, is_connected, is_powered, is_silent });
        self.update_links();
    }

    /// How many slaves there are, whether frames reach them or not.
    pub const fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there is no slave.
    pub const fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// A slave, from 0 on in the order in which they were added.
    ///
    /// # Panics
    /// If there is none with that number.
    pub fn slave(&self, n: usize) -> &EscSlave {
        &self.places[n].slave
    }

    /// Each slave is left as that other master leaves it, which ends at `now`.
    pub fn leave(&mut self, predecessor: &mut Predecessor, now: Ns) {
        self.places.iter_mut().for_each(|place| predecessor.leave(&mut place.slave, now));
        self.forget_routes();
    }

    /// A slave, to be changed.
    ///
    /// # Panics
    /// If there is none with that number.
    pub fn slave_mut(&mut self, n: usize) -> &mut EscSlave {
        self.forget_routes();
        &mut self.places[n].slave
    }

    /// Makes SDOs of a slave take that much longer, as [`EscSlave::delay_sdo`] says.
    ///
    /// # Panics
    /// If there is none with that number.
    pub fn delay_sdo(&mut self, n: usize, ns: Ns) {
        self.places[n].slave.delay_sdo(ns);
    }

    /// Sets how long a frame takes to a slave from the one before it, ns.
    ///
    /// # Panics
    /// If there is none with that number.
    pub fn set_hop(&mut self, n: usize, hop_ns: Ns) {
        self.forget_routes();
        self.places[n].hop_ns = hop_ns;
    }

    /// Cuts the cable in front of a slave, or repairs it.
    ///
    /// # Panics
    /// If there is none with that number.
    pub fn connect(&mut self, n: usize, is_connected: bool) {
        self.places[n].is_connected = is_connected;
        self.update_links();
    }

    /// Switches a slave off, or on at `now`, when it begins anew.
    ///
    /// # Panics
    /// If there is none with that number.
    pub fn power(&mut self, n: usize, is_powered: bool, now: Ns) {
        let place = &mut self.places[n];
        if is_powered && !place.is_powered {
            place.slave.power_on(now);
        }
        place.is_powered = is_powered;
        self.update_links();
    }

    /// Makes a slave let frames pass untouched, or take part in them again. Time passes in it.
    ///
    /// # Panics
    /// If there is none with that number.
    pub fn silence(&mut self, n: usize, is_silent: bool) {
        self.forget_routes();
        self.places[n].is_silent = is_silent;
    }

    /// Connects a second card to a port, 1 to 3, of a slave, so that the cables make a ring, or takes it away.
    ///
    /// # Panics
    /// If there is none with that number, or the port is none of 1 to 3, or a slave is there.
    pub fn connect_second(&mut self, ring: Option<(usize, usize)>) {
        if let Some((place, port)) = ring {
            assert!((1..PORTS).contains(&port), "cards are connected to ports 1 to 3");
            assert!(self.places[place].children[port].is_none(), "a slave is connected there");
        }
        self.ring = ring;
        self.update_links();
    }

    fn forget_routes(&mut self) {
        self.routes.iter_mut().for_each(|route| route.is_current = false);
    }

    fn update_links(&mut self) {
        self.forget_routes();
        for n in 0..self.places.len() {
            let mut links = [false; PORTS];
            links[0] = has_link(&self.places, n);
            for (link, child) in links.iter_mut().zip(self.places[n].children).skip(1) {
                *link = child.is_some_and(|child| has_link(&self.places, child));
            }
            if let Some((_, port)) = self.ring.filter(|(place, _)| *place == n) {
                links[port] = self.places[n].is_powered;
            }
            self.places[n].slave.set_links(links);
        }
    }

    /// A frame goes out at `now` before the first slave and is changed in place, as it comes back. Frames have to come in the
    /// order of their times.
    ///
    /// \[OURS] A frame whose datagrams do not fit into it has no effect but in the error counters of the slaves.
    pub fn process(&mut self, frame: &mut [u8], now: Ns) -> FrameFate {
        self.process_from(CableEnd::First, frame, now).0
    }

    /// A frame goes out at `now` at that end, as [`Self::process`] says; what becomes of it, and at which end it comes back.
    ///
    /// A frame from the last end passes the slaves untouched, until it is at the first end, or comes to a slave whose port 0
    /// is closed: from there back the slaves work on it, unless it has turned so before (ETG.1000.4, "circulating frame").
    pub fn process_from(&mut self, end: CableEnd, frame: &mut [u8], now: Ns) -> (FrameFate, CableEnd) {
        let place = usize::from(end == CableEnd::Last);
        if self.routes[place].exit.is_none() {
            // What loses frames may be a port that is open for a time.
            self.advance(now);
        }
        let mut route = std::mem::take(&mut self.routes[place]);
        if !route.is_current {
            let is_reached = !self.places.is_empty() && has_link(&self.places, 0);
            route.find(Slaves { places: &mut self.places, ring: self.ring, is_reached }, end, has_link);
        }
        let fate = match route.exit {
            Some(Exit { end, after_ns }) => (self.visit(frame, &mut route, now, now + after_ns), end),
            // The slaves before the hole have had it.
            None => {
                self.visit(frame, &mut route, now, now);
                (FrameFate::Lost, end)
            }
        };
        self.routes[place] = route;
        fate
    }

    fn visit(&mut self, frame: &mut [u8], route: &mut Route, now: Ns, back: Ns) -> FrameFate {
        if !route.is_worked_on {
            return FrameFate::Returned(back);
        }
        let Ok(decoded) = Frame::decode(frame) else {
            return if self.destroys_others(&route.visits) { FrameFate::Destroyed } else { FrameFate::Returned(back) };
        };
        let is_whole = self.passing.begin(decoded.datagrams());
        if route.turns && is_whole && !self.passing.begin_to_circulate() {
            return FrameFate::Destroyed;
        }
        for group in route.visits.chunk_by(|one, next| one.group == next.group) {
            let places = &mut self.places[group[0].place..][..group.len()];
            for (Place { slave, .. }, visit) in places.iter_mut().zip(group) {
                slave.begin_frame(now + visit.after_ns);
                if is_whole {
                    self.passing.each(frame, |header, data| slave.pass(header, data));
                } else {
                    slave.controller_mut().note_wrong_structure();
                }
                slave.end_frame();
                route.is_current &= !slave.ports_have_changed();
            }
            work(places);
        }
        self.passing.end(frame);
        mark_as_passed(frame);
        if !route.is_current {
            self.forget_routes();
        }
        FrameFate::Returned(back)
    }

    /// Whether a slave on the way destroys frames that are not of EtherCAT.
    fn destroys_others(&self, visits: &[Visit]) -> bool {
        visits.iter().any(|visit| {
            let control = self.places[visit.place].slave.controller().peek(DL_CONTROL, 1);
            control.first().is_some_and(|byte| u32::from(*byte) & DlControl::DESTROYS_OTHERS != 0)
        })
    }

    /// Time passes up to `now` in all slaves that have power.
    pub fn advance(&mut self, now: Ns) {
        self.places.iter_mut().filter(|place| place.is_powered).for_each(|place| place.slave.advance(now));
        let has_changed = |visit: &Visit| self.places[visit.place].slave.ports_have_changed();
        if self.routes.iter().any(|route| route.visits.iter().any(has_changed)) {
            self.forget_routes();
        }
    }
}

/// Whether there is a link between a slave and the one that it is connected to; for the first one, to the master.
fn has_link(places: &[Place], n: usize) -> bool {
    let place = &places[n];
    let parent_is_powered = place.parent.is_none_or(|(parent, _)| places[parent].is_powered);
    place.is_powered && place.is_connected && parent_is_powered
}

/// The devices of neighbours to which a frame has brought outputs work on them, their motors side by side.
fn work(places: &mut [Place]) {
    let mut motors = [const { None }; SIDE_BY_SIDE];
    let mut step_ns = 0;
    for (motor, place) in motors.iter_mut().zip(&mut *places) {
        *motor = place.slave.begin_work(&mut step_ns);
    }
    follow_side_by_side(&mut motors, step_ns);
    places.iter_mut().for_each(|place| place.slave.end_work());
}
