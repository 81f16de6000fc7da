//! A slave's place on the cable.

use super::EscSlave;
use crate::ethercat::Ns;
use crate::ethercat::registers::PORTS;

/// A slave on the cable.
pub(super) struct Place {
    pub(super) slave: EscSlave,
    /// The slave at each port but 0, by its place.
    pub(super) children: [Option<usize>; PORTS],
    /// Where the slave is connected: the place and the port.
    pub(super) parent: Option<(usize, usize)>,
    /// How long a frame takes from the parent, ns.
    pub(super) hop_ns: Ns,
    /// The cable to the parent is whole.
    pub(super) is_connected: bool,
    pub(super) is_powered: bool,
    /// Frames pass it untouched.
    pub(super) is_silent: bool,
}
