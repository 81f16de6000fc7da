//! Homing of a simulated drive: its methods on a travel with switches, and everything that ends a run.
//!
//! `methods.rs` and `random.rs` test the place of home, `ends.rs`, `errors.rs` and `inputs.rs` the end of a run,
//! `no_jump.rs` the axis when homing mode is entered and left; `bench.rs` is the drive under test.

mod bench;
mod ends;
mod errors;
mod inputs;
mod methods;
mod no_jump;
mod random;
