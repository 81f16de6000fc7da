//! The tree of the cables: for each slave, the slave and port to which it is connected.

use crate::ethercat::registers::{DlStatus, PORTS};

/// The ports by which a frame leaves a slave, in that order, when it has entered by port 0.
pub(super) const PORT_ORDER: [usize; PORTS - 1] = [3, 1, 2];

/// The slave and port to which another slave is connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Upstream {
    /// The next slave towards the master, from 1.
    pub slave: u8,
    /// The port of that slave, 1..=3.
    pub port: u8,
}

/// Whether frames leave a slave by a port.
pub(super) const fn is_open(ports: DlStatus, port: usize) -> bool {
    ports.communicates(port) && !ports.is_closed(port)
}

/// The slave and port to which each slave is connected, in network order; `None`: the master.
///
/// \[OURS] If the states of the ports fit no tree, the slaves are taken for a line.
pub fn upstreams(slaves: &[DlStatus]) -> Vec<Option<Upstream>> {
    walk(slaves).0
}

/// The open ports with a link behind which no slave was found. A ring is closed there by a second network card of the
/// master.
pub(super) fn loose_ends(slaves: &[DlStatus]) -> Vec<Upstream> {
    walk(slaves).1
}

/// The slave and port to which each slave is connected, and the open ports to which no slave is connected.
fn walk(slaves: &[DlStatus]) -> (Vec<Option<Upstream>>, Vec<Upstream>) {
    // The open ports by which the frame has not left its slave yet, in reverse order: the next one is last.
    let mut ahead: Vec<Upstream> = Vec::new();
    let mut upstreams = Vec::with_capacity(slaves.len());
    for (before, ports) in (0u8..).zip(slaves) {
        let upstream = match before {
            0 => None,
            slave => Some(ahead.pop().unwrap_or(Upstream { slave, port: 1 })),
        };
        upstreams.push(upstream);
        let open = PORT_ORDER.iter().rev().filter(|port| is_open(*ports, **port));
        ahead.extend(open.map(|port| Upstream { slave: before + 1, port: *port as u8 }));
    }
    (upstreams, ahead)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ports(open: &[usize]) -> DlStatus {
        (0..PORTS).fold(DlStatus::default(), |status, port| {
            let is_open = port == 0 || open.contains(&port);
            status.with_port(port, is_open, !is_open)
        })
    }

    fn found(slaves: &[&[usize]]) -> Vec<Option<(u8, u8)>> {
        let slaves: Vec<DlStatus> = slaves.iter().map(|open| ports(open)).collect();
        upstreams(&slaves).into_iter().map(|upstream| upstream.map(|up| (up.slave, up.port))).collect()
    }

    /// MASTER-2.4 A line, and a tree whose branches leave by ports 3, 1 and 2.
    #[test]
    fn trees_are_found_from_open_ports() {
        assert_eq!(found(&[]), []);
        assert_eq!(found(&[&[1], &[1], &[]]), [None, Some((1, 1)), Some((2, 1))]);
        // Slave 1 has slave 2 at port 3, slaves 3 and 4 in a line at port 1, and slave 5 at port 2.
        let tree: [&[usize]; 5] = [&[1, 2, 3], &[], &[1], &[], &[]];
        assert_eq!(found(&tree), [None, Some((1, 3)), Some((1, 1)), Some((3, 1)), Some((1, 2))]);
    }

    /// In a ring the last slave has an open port for the cable to the second card. No slave is behind that port, so it
    /// is found as a loose end.
    #[test]
    fn a_ring_ends_at_a_loose_end() {
        assert_eq!(loose_ends(&[ports(&[1]), ports(&[])]), []);
        assert_eq!(loose_ends(&[ports(&[1]), ports(&[1])]), [Upstream { slave: 2, port: 1 }]);
    }

    /// MASTER-2.4 If the states of the ports contradict each other, the slaves are taken for a line.
    #[test]
    fn ports_that_make_no_tree_make_a_line() {
        assert_eq!(found(&[&[], &[], &[]]), [None, Some((1, 1)), Some((2, 1))]);
    }
}
