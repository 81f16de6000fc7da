//! What runs a board: virtual time, the real clock, and the links to boards in this process.

mod boards;
mod client;
mod early;
mod habits;
mod slow;
mod stepped;
mod stress;
mod threaded;
