//! The native API: boards, axes, streams, and what a board can get wrong.

mod answers;
mod axes;
mod bad_boards;
mod bad_states;
mod board;
mod close;
mod common;
mod ends;
mod example;
mod homing;
mod kinds;
mod safety;
mod sdo;
mod states;
mod stream;
mod targets;
mod threads;
mod two_channels;
