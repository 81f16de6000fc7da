//! The route of a frame through the slaves on a cable. It is computed once, and again after a change of a cable or a port.

use super::place::Place;
use crate::ethercat::registers::PORTS;
use crate::ethercat::{CableEnd, Ns};
use crate::slave::plant::SIDE_BY_SIDE;

/// The order of the ports by which a frame leaves a slave; it returns by each port before it leaves by the next one.
const ORDER: [usize; PORTS - 1] = [3, 1, 2];

/// A slave on the route of a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Visit {
    /// The index of the slave in [`Chain`](super::Chain).
    pub(super) place: usize,
    /// The time from the start of the frame to its arrival at the slave, ns.
    pub(super) after_ns: Ns,
    /// The group number. The slaves of a group are neighbours; their devices process the outputs of the frame together, which
    /// is faster.
    pub(super) group: usize,
}

/// The end at which a frame leaves the slaves, and the time that it takes, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Exit {
    pub(super) end: CableEnd,
    pub(super) after_ns: Ns,
}

/// The route of a frame through the slaves, computed once and used until a cable or a port changes.
#[derive(Debug, Default)]
pub(super) struct Route {
    /// Whether the route is up to date: no cable or port has changed since it was computed.
    pub(super) is_current: bool,
    /// The slaves that process the frame, in the order in which it reaches them.
    pub(super) visits: Vec<Visit>,
    /// The exit of the frame; `None`: the frame gets lost.
    pub(super) exit: Option<Exit>,
    /// Whether any slave processes the frame. False for a frame from the last end that reaches the first end without turning
    /// round.
    pub(super) is_worked_on: bool,
    /// Whether the frame turns round at a closed port 0.
    pub(super) turns: bool,
}

/// The slaves on a cable, as input for computing a route.
pub(super) struct Slaves<'p> {
    pub(super) places: &'p mut [Place],
    /// The index of the slave, and its port, to which a second card is connected; `None` without a ring.
    pub(super) ring: Option<(usize, usize)>,
    /// Whether there is a link between the first slave and the card in front of it.
    pub(super) is_reached: bool,
}

impl Route {
    /// Computes the route of a frame from one end. Also sets the round-trip times per port in each slave on the route.
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
    /// Follows the frame through a slave that it enters by port 0 after `after_ns`, and through all slaves behind it. Returns
    /// the exit: the frame is back at port 0, or it has left the network at the last end; `None` if it is lost.
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

    /// Sends the frame out by a port other than 0 and back again; a closed port is skipped. Returns the exit; `None` if the
    /// frame is lost.
    fn go_out(&mut self, places: &mut [Place], place: usize, port: usize, at: Ns) -> Option<Exit> {
        if !places[place].slave.controller().is_open(port) {
            return Some(Exit { end: CableEnd::First, after_ns: at });
        }
        if self.ring == Some((place, port)) {
            return Some(Exit { end: CableEnd::Last, after_ns: at });
        }
        // The frame gets lost at an open port without a link.
        let child = places[place].children[port].filter(|child| (self.has_link)(places, *child))?;
        let hop_ns = places[child].hop_ns;
        let exit = self.go_on(places, child, at + hop_ns)?;
        let hop_ns = if exit.end == CableEnd::First { hop_ns } else { 0 };
        Some(Exit { after_ns: exit.after_ns + hop_ns, ..exit })
    }

    /// Follows a frame that was sent from the last end towards the first slave. It enters this slave at time `at` by a port
    /// other than 0, and passes slaves unprocessed until it turns round at a slave whose port 0 is closed. Returns the exit;
    /// `None` if the frame is lost.
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
