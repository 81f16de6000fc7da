//! Captures of real boards: read, shown, and replayed to the model.
#![cfg(feature = "cli")]

mod any;
#[path = "../cli_support/mod.rs"]
mod cli_support;
#[path = "../compare_support/mod.rs"]
mod compare_support;
mod convert;
mod page;
mod reader;
mod replay;
mod tool;
mod traffic;
