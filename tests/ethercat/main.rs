//! EtherCAT itself: its wire format.
//!
//! - `frames.rs`: frames and datagrams
//! - `al_status.rs`: AL status codes

mod al_status;
mod frames;
