//! The simulated DP3CL as its manual describes it.
//!
//! `bench.rs` is a drive with a master; `objects`, `parameters` and `process_data` are what SDOs see, `states` and `startup` its AL
//! states and alarms, `profile_position`, `profile_velocity`, `cyclic` and `limits` its modes, `homing`, `probes` and `terminals`
//! the rest.

mod bench;
mod cyclic;
mod homing;
mod objects;
mod page;
mod parameters;
mod probes;
mod process_data;
mod profile_position;
mod profile_velocity;
mod random;
mod startup;
mod states;
mod terminals;
