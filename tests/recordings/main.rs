//! Recordings of this project and captures of real boards: read, compared, and replayed on the model.
//!
//! Files:
//!
//! - `reader.rs`, `any.rs`: reading captures of every format, and any bytes
//! - `compare.rs`: comparing two runs
//! - `latency.rs`: comparing two runs with different latencies
//! - `replay.rs`: replaying a recording on the model
//! - `page.rs`: `docs/HARDWARE.md`

mod any;
mod compare;
mod latency;
mod page;
mod reader;
mod replay;
