//! The simulated slaves, each by itself: their objects and states, what they do with process data, how they move.
#![cfg(feature = "sim")]

mod dictionary;
mod drive;
#[path = "../fieldbus_rig/mod.rs"]
mod fieldbus_rig;
mod homing;
#[path = "../homing_tables/mod.rs"]
mod homing_tables;
mod hsp;
mod hsp_homing;
mod io;
mod least;
mod modules;
mod motion;
mod rig;
mod state_machine;
mod step;
