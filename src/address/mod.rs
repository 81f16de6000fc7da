//! The texts with which a user names a board: conversion from text to values and back. This module opens no link.
//!
//! - `uri.rs`, `scheme.rs`, `keys.rs` with `keys/table.rs`: the URI `scheme:path?key=value`, the schemes, and the table of
//!   all keys with their defaults
//! - `slaves.rs` with `slaves/list.rs`: lists of slaves; `kinds.rs`: the table of the kinds of slaves; `travel.rs`:
//!   switches and stops along the travel of their axes
//! - `scale.rs`: units of positions; `fraction.rs`: numbers from 0 to 1; `text.rs`: words and numbers
//! - `config.rs`: the link that is opened when a program does not name one (`ECMSK_LINK`, `ecmsk.toml`)

pub mod config;
mod fraction;
pub mod keys;
mod kinds;
pub(crate) mod scale;
pub(crate) mod scheme;
pub mod slaves;
pub(crate) mod text;
pub mod travel;
pub mod uri;

pub use fraction::Fraction;
