//! EtherCAT itself: its wire format.
//!
//! - `frames.rs`: frames and datagrams
//! - `registers.rs`: the registers of a slave controller
//! - `al_status.rs`: AL status codes

mod al_status;
mod frames;
mod registers;
