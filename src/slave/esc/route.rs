//! The way of a frame through the slaves of a cable. It is found once, and again when a cable or a port has changed.

use super::place::Place;
use crate::ethercat::registers::PORTS;
use crate::ethercat::{CableEnd, Ns};
use crate::slave::plant::SIDE_BY_SIDE;

/// The ports by which a frame leaves a slave, in the order in which it does.
const ORDER: [usize; PORTS - 1] = [3, 1, 2];

/// A slave that a frame passes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Visit {
    /// The slave, by its place.
    pub(super) place: usize,
    /// How long after its start the frame comes to the slave, ns.
    pub(super) after_ns: Ns,
    /// The number of its group: slaves of a group lie side by side, and their devices work together.
    pub(super) group: usize,
}

/// Where a frame leaves the slaves, and how long after it has come, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Exit {
    pub(super) end: CableEnd,
    pub(super) after_ns: Ns,
}

/// The way of a frame.
#[derive(Debug, Default)]
pub(super) struct Route {
    /// Whether nothing has changed since it was found.
    pub(super) is_current: bool,
    /// The slaves that the frame does not pass untouched, in its order.
    pub(super) visits: Vec<Visit>,
    /// Where the frame goes; `None`: it is lost.
    pub(super) exit: Option<Exit>,
    /// The processing unit of a slave is on the way.
    pub(super) is_worked_on: bool,
    /// The frame turns round at a port 0 that is closed.
    pub(super) turns: bool,
}

/// Slaves on a cable.
pub(super) struct Slaves<'p> {
    pub(super) places: &'p mut [Place],
    /// The place and the port to which a second card is connected.
    pub(super) ring: Option<(usize, usize)>,
    /// Whether there is a link between the first slave and the card before it.
    pub(super) is_reached: bool,
}

impl Route {
    /// Finds the way of a frame from that end. Tells each slave on it how long after coming a frame is back at its ports.
    pub(super) fn find(&mut self, slaves: Slaves<'_>, from: CableEnd, has_link: impl Fn(&[Place], usize) -> bool) {
        self.visits.clear();
        self.visits.reserve(slaves.places.len());
        (self.is_worked_on, self.turns) = (false, false);
        let Slaves { places, ring, is_reached } = slaves;
        let Self { visits, is_worked_on, turns, .. } = self;
        let mut search = Search { visits, is_worked_on, turns, ring, is_reached, has_link };
        self.exit = match (from, ring) {
            (CableEnd::First, _) if is_reached => search.go_on(places, 0, 0),
            (CableEnd::Last, Some((place, port))) => search.go_back(places, place, port, 0),
            _ => None,
        };
        self.is_current = true;
        let mut group = 0;
        let mut first = 0;
        for n in 1..self.visits.len() {
            let [before, here] = [self.visits[n - 1].place, self.visits[n].place];
            if here != before + 1 || n - first == SIDE_BY_SIDE {
                (group, first) = (group + 1, n);
            }
            self.visits[n].group = group;
        }
    }
}

struct Search<'v, L> {
    visits: &'v mut Vec<Visit>,
    is_worked_on: &'v mut bool,
    turns: &'v mut bool,
    ring: Option<(usize, usize)>,
    is_reached: bool,
    has_link: L,
}

impl<L: Fn(&[Place], usize) -> bool> Search<'_, L> {
    /// From a slave on, to which the frame comes after so long at port 0: when it is back there, or where it has left.
    fn go_on(&mut self, places: &mut [Place], place: usize, after_ns: Ns) -> Option<Exit> {
        *self.is_worked_on = true;
        if !places[place].is_silent {
            self.visits.push(Visit { place, after_ns, group: 0 });
        }
        let mut at = after_ns;
        let mut returns = [None; PORTS - 1];
        let mut exit = None;
        for port in ORDER {
            match self.go_out(places, place, port, at)? {
                Exit { end: CableEnd::First, after_ns: back } => {
                    if places[place].slave.controller().is_open(port) {
                        returns[port - 1] = Some(back - after_ns);
                    }
                    at = back;
                }
                left => {
                    exit = Some(left);
                    break;
                }
            }
        }
        places[place].slave.set_returns(returns);
        Some(exit.unwrap_or(Exit { end: CableEnd::First, after_ns: at }))
    }

    /// Out of a slave by a port other than 0, and back again; at once if the port is closed.
    fn go_out(&mut self, places: &mut [Place], place: usize, port: usize, at: Ns) -> Option<Exit> {
        if !places[place].slave.controller().is_open(port) {
            return Some(Exit { end: CableEnd::First, after_ns: at });
        }
        if self.ring == Some((place, port)) {
            return Some(Exit { end: CableEnd::Last, after_ns: at });
        }
        // An open port without a link is a hole.
        let child = places[place].children[port].filter(|child| (self.has_link)(places, *child))?;
        let hop_ns = places[child].hop_ns;
        let exit = self.go_on(places, child, at + hop_ns)?;
        let hop_ns = if exit.end == CableEnd::First { hop_ns } else { 0 };
        Some(Exit { after_ns: exit.after_ns + hop_ns, ..exit })
    }

    /// From a slave towards the first one, to which the frame comes after so long at another port than 0. It passes slaves
    /// untouched, until it comes to one whose port 0 is closed: there it turns round.
    fn go_back(&mut self, places: &mut [Place], place: usize, port: usize, at: Ns) -> Option<Exit> {
        let mut at = at;
        for next in ORDER.into_iter().skip_while(|other| *other != port).skip(1) {
            let exit = self.go_out(places, place, next, at)?;
            if exit.end == CableEnd::Last {
                return Some(exit);
            }
            at = exit.after_ns;
        }
        if !places[place].slave.controller().is_open(0) {
            *self.turns = true;
            return self.go_on(places, place, at);
        }
        let hop_ns = places[place].hop_ns;
        match places[place].parent {
            Some((parent, port)) => self.go_back(places, parent, port, at + hop_ns),
            None => self.is_reached.then_some(Exit { end: CableEnd::First, after_ns: at }),
        }
    }
}
