//! The virtual board on USB/IP: its messages, the device that a host's USB stack sees, and the server.
//!
//! Files:
//!
//! - `wire.rs`, `descriptors.rs`: the messages and the descriptors, byte by byte
//! - `device.rs`, `control.rs`, `unlink.rs`: the endpoints, endpoint 0, and transfers that the host cancels
//! - `server.rs`, `crowd.rs`, `attach.rs`: the server, clients that misbehave, and `--attach`
//! - `allocation.rs`: no allocation per report
//! - `board.rs`, `puppet.rs`: a device without a server, and a link whose board the test controls
#![cfg(target_os = "linux")]

mod allocation;
mod attach;
mod board;
mod control;
mod crowd;
mod descriptors;
mod device;
mod puppet;
mod server;
mod unlink;
mod wire;
