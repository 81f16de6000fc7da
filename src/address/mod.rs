//! What a person writes to name a board, and what it means: text to values and back. Nothing is opened here.
//!
//! - `uri.rs`, `scheme.rs`, `keys.rs` with `keys/table.rs`: the URI `scheme:path?key=value`; the schemes, and the table of all
//!   keys with their defaults
//! - `slaves.rs` with `slaves/list.rs`: lists of slaves; `kinds.rs`: the table of the kinds that there are; `travel.rs`: what is
//!   along the way of their axes
//! - `fraction.rs`: numbers between 0 and 1; `text.rs`: words and numbers
//! - `config.rs`: which link is opened when a program names none (`ECMSK_LINK`, `ecmsk.toml`)

pub mod config;
mod fraction;
pub mod keys;
mod kinds;
pub(crate) mod scheme;
pub mod slaves;
pub(crate) mod text;
pub mod travel;
pub mod uri;

pub use fraction::Fraction;
