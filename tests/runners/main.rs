//! What runs a board: virtual time, the real clock, and the links to boards in this process.
#![cfg(feature = "sim")]

mod boards;
#[path = "../bus_wrapper/mod.rs"]
mod bus_wrapper;
mod client;
mod early;
mod habits;
#[path = "../heard/mod.rs"]
mod heard;
mod slow;
mod stepped;
mod stress;
mod threaded;
