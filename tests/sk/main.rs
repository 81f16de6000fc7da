//! The wire format: golden frames, round trips, every command and report, the readable dump.
//!
//! Files:
//!
//! - `layout.rs`, `crc.rs`: the position of every field of a frame; the CRC
//! - `commands.rs`, `arguments.rs`: every command byte by byte; which values of its arguments are valid
//! - `golden.rs`, `roundtrip.rs`: golden frames; encoding and decoding of any value
//! - `dump.rs`: the readable dump
//! - `no_std.rs`: a firmware without `std`

mod arguments;
mod commands;
mod crc;
mod dump;
mod golden;
mod layout;
mod no_std;
mod roundtrip;
