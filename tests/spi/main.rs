//! The links `spi:` and `xf-spi:` without a kernel: the pacer of `spi:` in virtual time with the modelled board, links
//! over wires controlled by a test, and the board's side of the wires.
//!
//! Files:
//!
//! - `bench.rs`, `frames.rs`, `wires.rs`: the pacer with a modelled board, frames, and wires controlled by a test
//! - `drift.rs`, `motion.rs`, `prefill.rs`, `period.rs`, `answers.rs`: the pacer: two clocks, the program's view,
//!   `prefill=`, without BUSY, answers of slots
//! - `link.rs`, `open.rs`, `lies.rs`: the link, opening it, and faulty wires
//! - `board.rs`, `example.rs`: the board's end of the wires
//! - `embedded.rs`: hosts on a microcontroller
//! - `chip.rs`, `chip_wires.rs`: `xf-spi:`, and wires controlled by a test with the model of a chip
#![cfg(target_os = "linux")]

mod answers;
mod bench;
mod board;
mod chip;
mod chip_wires;
mod drift;
mod embedded;
mod example;
mod frames;
mod lies;
mod link;
mod motion;
mod open;
mod period;
mod prefill;
mod wires;
