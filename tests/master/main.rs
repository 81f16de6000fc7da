//! The software master, against simulated slaves behind their controllers, in virtual time.
//!
//! - `rig.rs`: the master with a wire to a chain of slaves
//! - `start.rs`: the scan, the way to OP, process data
//! - `objects.rs`: SDO
//! - `clocks.rs`: distributed clocks
//! - `faults.rs`: frames that are lost, late, doubled
//! - `lost.rs`: slaves that go and come back

mod clocks;
mod faults;
mod lost;
mod objects;
mod rig;
mod start;
