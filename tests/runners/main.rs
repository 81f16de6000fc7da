//! Runners of a board: virtual time, the real clock, and the links to boards in this process.
//!
//! Files:
//!
//! - `stepped.rs`, `threaded.rs`: virtual time, and the real clock
//! - `early.rs`, `slow.rs`, `stress.rs`: the real clock: never early, on a slow machine, with many threads
//! - `boards.rs`: boards that outlive their links
//! - `behind_chip.rs`: boards whose slaves are behind an ECM-XF
//! - `chip_board.rs`: a board over a chip on the real clock, as over a real one
//! - `habits.rs`, `client.rs`: sequences of calls of existing applications, and the client that makes them

mod behind_chip;
mod boards;
mod chip_board;
mod client;
mod early;
mod habits;
mod slow;
mod stepped;
mod stress;
mod threaded;
