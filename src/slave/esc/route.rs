//! The way of a frame through the slaves of a cable. It is found once, and again when a cable or a port has changed.

use super::chain::Place;
use crate::ethercat::Ns;
use crate::ethercat::registers::PORTS;
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

/// The way of a frame.
#[derive(Debug, Default)]
pub(super) struct Route {
    /// Whether nothing has changed since it was found.
    pub(super) is_current: bool,
    /// The slaves that the frame does not pass untouched, in its order.
    pub(super) visits: Vec<Visit>,
    /// How long the frame takes, ns; `None`: it is lost.
    pub(super) back_ns: Option<Ns>,
}

impl Route {
    /// Finds the way through these slaves, of which the first one has a link to the master or not. Tells each slave on it how
    /// long after coming a frame is back at its ports.
    pub(super) fn find(&mut self, places: &mut [Place], is_reached: bool, has_link: impl Fn(&[Place], usize) -> bool) {
        self.visits.clear();
        self.visits.reserve(places.len());
        let mut search = Search { visits: &mut self.visits, has_link };
        self.back_ns = if is_reached { search.go_on(places, 0, 0) } else { None };
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
    has_link: L,
}

impl<L: Fn(&[Place], usize) -> bool> Search<'_, L> {
    /// From a slave on, to which the frame comes after so long: when it is back there.
    fn go_on(&mut self, places: &mut [Place], place: usize, after_ns: Ns) -> Option<Ns> {
        if !places[place].is_silent {
            self.visits.push(Visit { place, after_ns, group: 0 });
        }
        let mut at = after_ns;
        let mut returns = [None; PORTS - 1];
        for port in ORDER {
            if !places[place].slave.controller().is_open(port) {
                continue;
            }
            // An open port without a link is a hole.
            let child = places[place].children[port].filter(|child| (self.has_link)(places, *child))?;
            let hop = places[child].hop_ns;
            at = self.go_on(places, child, at + hop)? + hop;
            returns[port - 1] = Some(at - after_ns);
        }
        places[place].slave.set_returns(returns);
        Some(at)
    }
}
