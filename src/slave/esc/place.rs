//! The position of a slave on the cable.

use super::EscSlave;
use crate::ethercat::Ns;
use crate::ethercat::registers::PORTS;

/// A slave with its connections on the cable. Other slaves are named by their index in [`Chain`](super::Chain).
pub(super) struct Place {
    pub(super) slave: EscSlave,
    /// The indices of the slaves that are connected to ports 1 to 3.
    pub(super) children: [Option<usize>; PORTS],
    /// The index of the slave, and its port, to which port 0 of this slave is connected; `None` for the first slave.
    pub(super) parent: Option<(usize, usize)>,
    /// The time that a frame takes from the parent to this slave, ns.
    pub(super) hop_ns: Ns,
    /// Whether the cable to the parent is intact.
    pub(super) is_connected: bool,
    pub(super) is_powered: bool,
    /// Whether the slave forwards frames without processing them.
    pub(super) is_silent: bool,
}
