//! Homing of a simulated drive: its methods on a travel with switches, and everything that ends a run.
//!
//! `methods.rs` and `random.rs` ask where home is, `ends.rs`, `errors.rs` and `inputs.rs` how a run ends, `no_jump.rs` what the
//! axis does on the way into homing and out of it; `bench.rs` is the drive under test.

mod bench;
mod ends;
mod errors;
mod inputs;
mod methods;
mod no_jump;
mod random;
