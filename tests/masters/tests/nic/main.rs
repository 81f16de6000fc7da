//! The software master, behind the link `nic:`, on simulated slaves: the board's program drives them without a board.
//!
//! - `start.rs`: the choice of the card, from the start to a motion, and the end
//! - `kinds.rs`: 40 slaves of every kind
//! - `trouble.rs`: frames that are lost, late, doubled or strange, a card that is down, slaves that are lost and come
//!   back
//! - `ring.rs`: two cards
//! - `gone.rs`: cards that are pulled
//! - `ends.rs`: programs that end in the middle of a motion
//! - `programs.rs`: example programs, unchanged
#![cfg(target_os = "linux")]

mod ends;
mod gone;
mod kinds;
mod programs;
mod ring;
mod start;
mod trouble;
