//! Homing of a simulated drive: its methods on a travel with switches, and everything that ends a run.
#![cfg(feature = "sim")]

#[path = "../fieldbus_rig/mod.rs"]
mod fieldbus_rig;
#[path = "../slave_rig/mod.rs"]
mod slave_rig;

mod bench;
mod ends;
mod errors;
mod inputs;
mod methods;
mod no_jump;
mod random;
