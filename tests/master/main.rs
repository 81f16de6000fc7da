//! The software master, against simulated slaves behind their controllers, in virtual time.
//!
//! - `rig.rs`: the master with a wire to a chain of slaves
//! - `start.rs`: the scan, the way to OP, process data
//! - `objects.rs`: SDO
//! - `clocks.rs`: distributed clocks
//! - `files.rs`: FoE
//! - `makers.rs`: EEPROMs, controllers and answers of manufacturers' slaves
//! - `odd_line.rs`, `odd_states.rs`, `odd_clocks.rs`, `odd_answers.rs`: slaves with an implementation of their own,
//!   independent of the models; `odd_rig.rs`: the master with a wire to them
//! - `registers.rs`: registers, EEPROM words, single datagrams
//! - `hostile.rs`: slaves that answer anything
//! - `faults.rs`: frames that are lost, late, doubled
//! - `predecessor.rs`: slaves as another master has left them
//! - `watchdog.rs`: the watchdog that stops slaves when the master is gone
//! - `lost.rs`: slaves that go and come back
//! - `ring.rs`: two cards at the ends of the cable
//! - `allocation.rs`: what allocates nothing

mod allocation;
mod clocks;
mod faults;
mod files;
mod hostile;
mod lost;
mod makers;
mod objects;
mod odd_answers;
mod odd_clocks;
mod odd_line;
mod odd_rig;
mod odd_states;
mod predecessor;
mod registers;
mod rig;
mod ring;
mod start;
mod watchdog;
