//! Recordings of this project and captures of real boards: read, compared, and replayed to the model.
//!
//! Files:
//!
//! - `reader.rs`, `any.rs`: reading captures of every format, and any bytes
//! - `compare.rs`: comparing two runs
//! - `latency.rs`: comparing two runs of which one answers later
//! - `replay.rs`: playing a recording to the model
//! - `page.rs`: `docs/HARDWARE.md`

mod any;
mod compare;
mod latency;
mod page;
mod reader;
mod replay;
