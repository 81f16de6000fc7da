//! The simulated slaves, each by itself: their objects and states, what they do with process data, how they move.

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
