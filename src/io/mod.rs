//! Bytes and wires, without a word of what they mean.

pub mod hid;
