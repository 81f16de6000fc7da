//! The simulated DP3CL as its manual describes it.
//!
//! `bench.rs` is a drive with a master; `objects`, `parameters`, `monitors` and `process_data` are what SDOs see, `states`, `startup` and
//! `alarms` its AL states and alarms, `profile_position`, `profile_velocity`, `cyclic` and `option_codes` its modes, `homing`, `probes` and
//! `terminals` the rest.

mod alarms;
mod bench;
mod cyclic;
mod homing;
mod monitors;
mod objects;
mod option_codes;
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
