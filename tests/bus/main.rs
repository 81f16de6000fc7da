//! `ecmsk::bus` on simulated slaves in virtual time.
//!
//! - `network.rs`: kinds of networks, the scan, cut cables
//! - `objects.rs`, `eeprom.rs`, `files.rs`, `clocks.rs`: SDO, SII, FoE, distributed clocks
//! - `cables.rs`: error counters, and which cable is bad
//! - `chip.rs`: an ECM-XF
//! - `odd_line.rs`: slaves with an implementation of their own, independent of the models

mod cables;
mod chip;
mod clocks;
mod eeprom;
mod files;
mod network;
mod objects;
mod odd_line;

use ecmsk::bus::{self, BusError, FoundSlave, Network};

/// The network of these slaves with its slaves, and that script.
fn with_script(slaves: &str, script: &str) -> (Box<dyn Network>, Vec<FoundSlave>) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("script.ecmscript");
    std::fs::write(&file, script).expect("it is written");
    let mut network = bus::open(&format!("sim:?slaves={slaves}&script={}", file.display())).expect("a network");
    let found = network.scan().expect("slaves");
    (network, found)
}

/// The network of these slaves, with its slaves.
fn network(slaves: &str) -> (Box<dyn Network>, Vec<FoundSlave>) {
    let mut network = bus::open(&format!("sim:?slaves={slaves}")).expect("a network");
    let found = network.scan().expect("slaves");
    (network, found)
}

/// The error of a call that fails.
#[track_caller]
fn refused<T>(result: Result<T, BusError>) -> String {
    match result {
        Ok(_) => panic!("it is not refused"),
        Err(error) => error.to_string(),
    }
}
