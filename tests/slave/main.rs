//! The simulated slaves, each without a network: their objects, states and process data, and how they move.
//!
//! `drive`, `step`, `dp3cl/`, `hsp` and `io` are the kinds, `modules` and `least` what they have alike and need not have; `dictionary` and
//! `mapping`, `maps` are objects and process data, `state_machine` and `motion` the CiA 402 states and what moves a shaft, `limit_switches`
//! where a motion ends, `homing/` and `hsp_homing` homing.
//!
//! `examples_page` compares a page with them. `rig.rs` is a drive with a master, `homing/bench.rs` one in homing mode, and `wired.rs` configures any slave as the board does.

mod dictionary;
mod dp3cl;
mod drive;
mod examples_page;
mod homing;
mod hsp;
mod hsp_homing;
mod information;
mod io;
mod least;
mod limit_switches;
mod mapping;
mod maps;
mod modules;
mod motion;
mod rig;
mod state_machine;
mod step;
mod wired;
