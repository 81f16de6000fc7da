//! The virtual board on USB/IP: its messages, the device that a host's USB stack sees, and the server.
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
