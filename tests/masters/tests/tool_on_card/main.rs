//! The tool as a user runs it on a network card with slaves at its end, the library aside: what it says of the network is so, what one
//! run writes the next one finds, and what cannot be done is told.
//!
//! - `card.rs`: running the tool there
//! - `shown.rs`: what there is, how well clocks keep together, which cable is bad
//! - `written.rs`: objects, files and EEPROMs
//! - `told.rs`: whether the card is fit, and what goes wrong
//! - `ring.rs`: two cards
//! - `gone.rs`: cards that are pulled
#![cfg(target_os = "linux")]

mod card;
mod gone;
mod ring;
mod shown;
mod told;
mod written;
