//! EtherCAT itself: its wire format, and slaves as the wire sees them.
//!
//! - `frames.rs`: frames and datagrams
//! - `registers.rs`: the registers of a slave controller
//! - `sii.rs`: EEPROMs
//! - `mailbox.rs`: mailbox messages, and files in them
//! - `coe.rs`: SDO, SDO information, emergencies
//! - `al_status.rs`: AL status codes
//! - `esc/`: slave controllers around simulated slaves

mod al_status;
mod coe;
mod esc;
mod frames;
mod mailbox;
mod registers;
mod sii;
