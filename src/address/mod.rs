//! What a person writes to name a board, and what it means: text to values and back. Nothing is opened here.
//!
//! - `uri.rs`, `scheme.rs`, `keys.rs` with `keys/table.rs`: the URI `scheme:path?key=value`; the schemes, and the table of all
//!   keys with their defaults
//! - `slaves.rs` with `slaves/kinds.rs`, `travel.rs`: the list of simulated slaves, the kinds that there are, and what is along
//!   the way of their axes
//! - `fraction.rs`: numbers between 0 and 1
//! - `config.rs`: which link is opened when a program names none (`ECMSK_LINK`, `ecmsk.toml`)

pub mod config;
mod fraction;
pub mod keys;
mod scheme;
pub mod slaves;
pub mod travel;
pub mod uri;

pub use fraction::Fraction;
