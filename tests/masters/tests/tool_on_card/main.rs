//! The tool as a user runs it on a network card with slaves at its end, checked by the library: its reports on the
//! network are true, the next run finds what one run has written, and failures are reported.
//!
//! - `card.rs`: running the tool there
//! - `shown.rs`: the slaves, the synchronisation of clocks, bad cables
//! - `written.rs`: objects, files and EEPROMs
//! - `machine.rs`: the machine file, and parameters of drives
//! - `told.rs`: whether the card is usable, and its faults
//! - `ring.rs`: two cards
//! - `gone.rs`: cards that are pulled
//! - `page.rs`: the commands of docs/DEAD-BOARD.md
//! - `stalled.rs`: moves whose process stands still
//! - `odd.rs`: slaves that keep to the standard in unusual ways
#![cfg(target_os = "linux")]

mod card;
mod gone;
mod machine;
mod odd;
mod page;
mod ring;
mod shown;
mod stalled;
mod told;
mod written;
