//! The simulated slaves, each without a network: their objects, states and process data, and how they move.
//!
//! `rig.rs` is a drive with a master, `homing/bench.rs` one in homing mode, and `wired.rs` configures any slave as the board does.

mod dictionary;
mod drive;
mod homing;
mod hsp;
mod hsp_homing;
mod io;
mod least;
mod mapping;
mod modules;
mod motion;
mod rig;
mod state_machine;
mod step;
mod wired;
