//! The durations of the jobs of the simulated bus.

use crate::fieldbus::{AlState, CHANGE_SLAVE_NS, LEAVING_OP_NS, Ns};

/// The durations of the jobs and SDO transfers of a simulated network, ns of board time.
///
/// \[OURS] The only source is "takes many cycles, PreOP to SafeOP the longest" (SK-4). These are the durations of a
/// small network of servo drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// The fixed part of a scan: the time until the link is up and the slaves are counted.
    pub scan_ns: Ns,
    /// The time that a scan takes for each slave, to read its identity.
    pub scan_slave_ns: Ns,
    /// The time that the configuration of one slave takes, with all its SDO transfers.
    pub configure_slave_ns: Ns,
    /// The fixed part of a change of state from Init to PreOP.
    pub to_preop_ns: Ns,
    /// The fixed part of a change of state from PreOP to SafeOP, in which the drives synchronise.
    pub to_safeop_ns: Ns,
    /// The fixed part of a change of state from SafeOP to OP.
    pub to_op_ns: Ns,
    /// The fixed part of a change to a lower state, or of a repeated request of the state that a slave is already in.
    pub down_ns: Ns,
    /// The time that each slave in a change of state adds to its duration.
    pub change_slave_ns: Ns,
    /// The time after which a state is requested again from a slave that has not answered.
    pub retry_ns: Ns,
    /// The duration of one SDO transfer.
    pub sdo_ns: Ns,
}

impl Default for Timing {
    fn default() -> Self {
        const MS: Ns = 1_000_000;
        Self {
            scan_ns: 200 * MS,
            scan_slave_ns: 5 * MS,
            configure_slave_ns: 10 * MS,
            to_preop_ns: 50 * MS,
            to_safeop_ns: 300 * MS,
            to_op_ns: 50 * MS,
            down_ns: LEAVING_OP_NS,
            change_slave_ns: CHANGE_SLAVE_NS,
            retry_ns: 10 * MS,
            sdo_ns: 3 * MS,
        }
    }
}

impl Timing {
    /// The duration of one change of state of `slaves` slaves, ns.
    pub(super) const fn change_ns(&self, from: AlState, to: AlState, slaves: u8) -> Ns {
        let change = match (from, to) {
            (AlState::Init, AlState::PreOp) => self.to_preop_ns,
            (AlState::PreOp, AlState::SafeOp) => self.to_safeop_ns,
            (AlState::SafeOp, AlState::Op) => self.to_op_ns,
            _ => self.down_ns,
        };
        change + self.change_slave_ns * slaves as Ns
    }
}
