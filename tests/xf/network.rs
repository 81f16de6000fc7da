//! The network of these tests: two servo drives and an IO module, and the requests that bring it up.

use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::slave::{Drive, DriveConfig, Io, Slave};
use ecmsk::xf::EtherCatState;
use ecmsk::xf::request::{DcTiming, EcatInit, ReferenceClock, SdoOperation, SdoRequest, Slaves, StateSet};

/// 1 ms cycles with SYNC0, the FIFO off.
pub const INIT: EcatInit = EcatInit {
    special_slaves: false,
    reference_clock: ReferenceClock::FirstSlave,
    lrw: true,
    fifo_on: false,
    dc: DcTiming { assign_activate: 0x0300, sync0_ns: 1_000_000, sync1_ns: 0, shift_ns: 0 },
};

pub fn drive() -> Box<dyn Slave> {
    Box::new(Drive::new(DriveConfig::default()))
}

/// Two servo drives and an IO module.
pub fn drives_and_io() -> Vec<Box<dyn Slave>> {
    vec![drive(), drive(), Box::new(Io::default())]
}

pub fn to_all(state: EtherCatState) -> StateSet {
    StateSet { slaves: Slaves::All, state }
}

pub fn sdo(slave: u8, index: u16, sub: u8, operation: SdoOperation<'_>) -> SdoRequest<'_> {
    SdoRequest {
        slave: crate::slave(slave),
        object: ObjectAddress::new(index, sub),
        scope: SdoScope::Entry,
        timeout_us: 100_000,
        operation,
    }
}
