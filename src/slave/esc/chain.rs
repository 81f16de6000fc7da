//! Slaves on a cable: a frame passes all of them and returns.
//!
//! The cable is a tree. A frame leaves a slave through port 3, then 1, then 2, and returns through port 0; closed ports
//! are skipped. A second card at the last slave makes the network a ring. All times are of one simulated clock for the
//! whole network; the clock of each slave is a drifting copy of that clock.

use super::passing::Passing;
use super::place::Place;
use super::route::{Exit, Route, Slaves, Visit};
use super::{EscSlave, Predecessor};
use crate::ethercat::registers::{DL_CONTROL, DlControl, PORTS};
use crate::ethercat::{CableEnd, Frame, Ns, mark_as_passed};
use crate::slave::plant::{SIDE_BY_SIDE, follow_side_by_side};

/// \[OURS] The default time that a frame takes from one slave to the next, ns: some metres of cable and two ports.
pub const HOP_NS: Ns = 310;

/// The outcome of sending a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameFate {
    /// The frame comes back at that time, to the card that sent it or to the other end of a ring.
    Returned(Ns),
    /// A slave has destroyed the frame, because it is not an EtherCAT frame.
    Destroyed,
    /// The frame is lost: it reaches no slave, or it left an open port without a link.
    Lost,
}

/// A network of slaves with their slave controllers, connected as a tree.
#[derive(Default)]
pub struct Chain {
    places: Vec<Place>,
    /// The index of the slave, and its port, to which a second network card is connected, which makes the network a ring;
    /// `None` without a second card.
    ring: Option<(usize, usize)>,
    /// The routes of frames from the first end and from the last end of the line, kept until a cable or a port changes.
    routes: [Route; 2],
    /// The list of the present frame's datagrams, kept from frame to frame so that no frame allocates.
    passing: Passing,
}

impl Chain {
    /// A line of slaves, each connected to port 1 of the previous one.
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

    /// Connects a slave to port 1 to 3 of slave `parent` and returns the number of the new slave. If that port already has a
    /// slave, the new slave is dropped, and no slave has the returned number.
    ///
    /// # Panics
    /// If there is no slave `parent`, or the port is not in 1..=3.
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

    /// The number of slaves, including those that frames do not reach.
    pub const fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there is no slave.
    pub const fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// The slave with number `n`, from 0, in the order in which they were added.
    ///
    /// # Panics
    /// If there is no slave with that number.
    pub fn slave(&self, n: usize) -> &EscSlave {
        &self.places[n].slave
    }

    /// Puts each slave into a random state, as a previous master may have left it at `now`, see [`Predecessor`].
    pub fn leave(&mut self, predecessor: &mut Predecessor, now: Ns) {
        self.places.iter_mut().for_each(|place| predecessor.leave(&mut place.slave, now));
        self.forget_routes();
    }

    /// The slave with number `n`, mutable.
    ///
    /// # Panics
    /// If there is no slave with that number.
    pub fn slave_mut(&mut self, n: usize) -> &mut EscSlave {
        self.forget_routes();
        &mut self.places[n].slave
    }

    /// Delays the SDOs of a slave by `ns`, see [`EscSlave::delay_sdo`].
    ///
    /// # Panics
    /// If there is no slave with that number.
    pub fn delay_sdo(&mut self, n: usize, ns: Ns) {
        self.places[n].slave.delay_sdo(ns);
    }

    /// Sets the time that a frame takes from the previous slave to slave `n`, ns.
    ///
    /// # Panics
    /// If there is no slave with that number.
    pub fn set_hop(&mut self, n: usize, hop_ns: Ns) {
        self.forget_routes();
        self.places[n].hop_ns = hop_ns;
    }

    /// Repairs the cable in front of a slave, or cuts it.
    ///
    /// # Panics
    /// If there is no slave with that number.
    pub fn connect(&mut self, n: usize, is_connected: bool) {
        self.places[n].is_connected = is_connected;
        self.update_links();
    }

    /// Switches a slave off, or switches it on at `now`, which restarts it.
    ///
    /// # Panics
    /// If there is no slave with that number.
    pub fn power(&mut self, n: usize, is_powered: bool, now: Ns) {
        let place = &mut self.places[n];
        if is_powered && !place.is_powered {
            place.slave.power_on(now);
        }
        place.is_powered = is_powered;
        self.update_links();
    }

    /// Makes a slave forward frames without processing them, or process them again. Its time advances in both cases.
    ///
    /// # Panics
    /// If there is no slave with that number.
    pub fn silence(&mut self, n: usize, is_silent: bool) {
        self.forget_routes();
        self.places[n].is_silent = is_silent;
    }

    /// Connects a second card to port 1 to 3 of a slave, which makes the network a ring, or disconnects it.
    ///
    /// # Panics
    /// If there is no slave with that number, the port is not in 1..=3, or the port has a slave.
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

    /// Sends a frame at `now` in front of the first slave. On return, `frame` contains the frame as it comes back to
    /// the master. Frames have to be sent in the order of their times.
    ///
    /// \[OURS] A frame whose datagrams are longer than the frame only increments error counters of the slaves.
    pub fn process(&mut self, frame: &mut [u8], now: Ns) -> FrameFate {
        self.process_from(CableEnd::First, frame, now).0
    }

    /// Sends a frame at `now` from one end, like [`Self::process`]. Returns the outcome, and the end at which the frame
    /// comes back.
    ///
    /// A frame from the last end passes slaves unprocessed until it reaches the first end, or a slave whose port 0 is
    /// closed. There it turns round, and the slaves process it on the way back, unless it has turned round before
    /// (ETG.1000.4, "circulating frame").
    pub fn process_from(&mut self, end: CableEnd, frame: &mut [u8], now: Ns) -> (FrameFate, CableEnd) {
        let place = usize::from(end == CableEnd::Last);
        if self.routes[place].exit.is_none() {
            // On the route of the previous frame, this frame would be lost at an open port without a link. If temporary
            // loop settings have opened the port, they may have ended by `now`. So the slaves are advanced first, which
            // closes the port.
            self.advance(now);
        }
        let mut route = std::mem::take(&mut self.routes[place]);
        if !route.is_current {
            let is_reached = !self.places.is_empty() && has_link(&self.places, 0);
            route.find(Slaves { places: &mut self.places, ring: self.ring, is_reached }, end, has_link);
        }
        let fate = match route.exit {
            Some(Exit { end, after_ns }) => (self.visit(frame, &mut route, now, now + after_ns), end),
            // The frame is lost at an open port without a link. The slaves in front of that port have processed it.
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

    /// Whether a slave on the route destroys frames that are not EtherCAT frames.
    fn destroys_others(&self, visits: &[Visit]) -> bool {
        visits.iter().any(|visit| {
            let control = self.places[visit.place].slave.controller().peek(DL_CONTROL, 1);
            control.first().is_some_and(|byte| u32::from(*byte) & DlControl::DESTROYS_OTHERS != 0)
        })
    }

    /// Advances all slaves that have power to `now`.
    pub fn advance(&mut self, now: Ns) {
        self.places.iter_mut().filter(|place| place.is_powered).for_each(|place| place.slave.advance(now));
        let has_changed = |visit: &Visit| self.places[visit.place].slave.ports_have_changed();
        if self.routes.iter().any(|route| route.visits.iter().any(has_changed)) {
            self.forget_routes();
        }
    }
}

/// Whether there is a link between a slave and its parent; for the first slave, between the slave and the master.
fn has_link(places: &[Place], n: usize) -> bool {
    let place = &places[n];
    let parent_is_powered = place.parent.is_none_or(|(parent, _)| places[parent].is_powered);
    place.is_powered && place.is_connected && parent_is_powered
}

/// Lets the devices of up to [`SIDE_BY_SIDE`] neighbouring slaves process the outputs that they have received. Their motors are
/// computed together with vector instructions, which is faster than one after the other.
fn work(places: &mut [Place]) {
    let mut motors = [const { None }; SIDE_BY_SIDE];
    let mut step_ns = 0;
    for (motor, place) in motors.iter_mut().zip(&mut *places) {
        *motor = place.slave.begin_work(&mut step_ns);
    }
    follow_side_by_side(&mut motors, step_ns);
    places.iter_mut().for_each(|place| place.slave.end_work());
}
