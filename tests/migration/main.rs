//! Old programs on an ECM-XF: one program runs on a board with slaves of its own (`sim:`) and on the same board whose
//! slaves are behind the model of a chip (`xf-sim:`), and what is different is a row of the table in docs/MIGRATION.md.
//!
//! - `machine.rs`, `tap.rs`: the machine twice, with a tap on each slave; `judge.rs`: the slaves' outputs compared
//! - `plan.rs`, `play.rs`, `play/`, `random.rs`: generated programs
//! - `recordings.rs`: recordings, played to both
//! - `vendor.rs`: programs written like the vendor's examples
//! - `rows.rs`: the table is the document's. `latency.rs`, `stall.rs`, `hold.rs`, `clear.rs`, `leaving.rs`, `loss.rs`,
//!   `remap.rs`, `sdo.rs`, `lio.rs`, `start.rs`: each measures the row of its name; `drives.rs` is what they share

mod clear;
mod drives;
mod hold;
mod judge;
mod latency;
mod leaving;
mod lio;
mod loss;
mod machine;
mod plan;
mod play;
mod random;
mod recordings;
mod remap;
mod rows;
mod sdo;
mod stall;
mod start;
mod tap;
mod vendor;
