//! The wire format: golden frames, round trips, every command and report, the readable dump.

mod arguments;
mod commands;
mod crc;
mod dump;
mod golden;
mod layout;
mod no_std;
mod roundtrip;
