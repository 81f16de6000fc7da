//! Homing of a simulated drive: its methods on a travel with switches, and everything that ends a run.

mod bench;
mod ends;
mod errors;
mod inputs;
mod methods;
mod no_jump;
mod random;
