//! How long the jobs of the simulated bus take.

use crate::fieldbus::{AlState, Ns};

/// Durations in board time.
///
/// \[OURS] No source gives any but "takes many cycles, PreOP to SafeOP the longest" (SK-4): these are those of a small
/// network of servo drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// Scan: link up, and counting the slaves.
    pub scan_ns: Ns,
    /// Scan: reading the identity of each slave.
    pub scan_slave_ns: Ns,
    /// Configure: the SDOs of each slave.
    pub configure_slave_ns: Ns,
    /// Init to PreOP.
    pub to_preop_ns: Ns,
    /// PreOP to SafeOP: the drives synchronise.
    pub to_safeop_ns: Ns,
    /// SafeOP to OP.
    pub to_op_ns: Ns,
    /// To a lower state, or to the one a slave is in.
    pub down_ns: Ns,
    /// A change of state, on top: for each slave that changes.
    pub change_slave_ns: Ns,
    /// How often a slave that does not answer is asked again.
    pub retry_ns: Ns,
    /// An SDO transfer.
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
            down_ns: 20 * MS,
            change_slave_ns: 2 * MS,
            retry_ns: 10 * MS,
            sdo_ns: 3 * MS,
        }
    }
}

impl Timing {
    /// How long `slaves` slaves take for one change of state.
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
