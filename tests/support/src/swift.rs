//! A network with fast changes of state.

use ecmsk::fieldbus::sim::Timing;

/// Fast changes of state, so that frames come in every phase of them.
pub const SWIFT: Timing = Timing {
    scan_ns: 2_000_000,
    scan_slave_ns: 100_000,
    configure_slave_ns: 1_000_000,
    to_preop_ns: 3_000_000,
    to_safeop_ns: 10_000_000,
    to_op_ns: 3_000_000,
    down_ns: 2_000_000,
    change_slave_ns: 100_000,
    retry_ns: 5_000_000,
    sdo_ns: 3_000_000,
};
