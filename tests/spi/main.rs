//! The link `spi:` without a kernel: its pacer in virtual time against the modelled board, the link over wires that a
//! test holds, and the board's side of the wires.
#![cfg(target_os = "linux")]

mod answers;
mod bench;
mod board;
mod drift;
mod example;
mod frames;
mod lies;
mod link;
mod motion;
mod open;
mod period;
mod prefill;
mod wires;
