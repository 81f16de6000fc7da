//! Captures of real boards: read, shown, and replayed to the model.
#![cfg(feature = "sim")]

mod convert;
mod reader;
mod traffic;
