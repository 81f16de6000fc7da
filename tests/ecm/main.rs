//! The native API: boards, axes, streams, and faults of a board.
//!
//! Files:
//!
//! - `states.rs`, `board.rs`, `close.rs`: opening, configuring, changing states; CRC, FIFO, reset; closing
//! - `axes.rs`, `homing.rs`, `sdo.rs`, `kinds.rs`, `two_channels.rs`: axes and IO, homing of several axes, SDOs,
//!   steppers and pulse modules
//! - `stream.rs`, `targets.rs`: cyclic targets
//! - `threads.rs`, `answers.rs`, `ends.rs`, `interrupt.rs`: several threads, lost frames, calls that something comes
//!   between, or that the program interrupts
//! - `bad_states.rs`, `bad_boards.rs`: every call in every state, and with every failure of a board
//! - `stop.rs`: what another program has left moving; `held_back.rs`: axes that do not follow
//! - `safety.rs`, `example.rs`: the statements of docs/SAFETY.md; the programs of `examples/rust/`
//! - `common/`: programs and links that the tests share

mod answers;
mod axes;
mod bad_boards;
mod bad_states;
mod board;
mod close;
mod common;
mod dp3cl;
mod ends;
mod example;
mod held_back;
mod homing;
mod interrupt;
mod kinds;
mod safety;
mod sdo;
mod states;
mod stop;
mod stream;
mod targets;
mod threads;
mod two_channels;
