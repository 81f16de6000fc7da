//! EtherCAT itself: its wire format.
//!
//! - `frames.rs`: frames and datagrams
//! - `registers.rs`: the registers of a slave controller
//! - `sii.rs`: EEPROMs
//! - `al_status.rs`: AL status codes

mod al_status;
mod frames;
mod registers;
mod sii;
