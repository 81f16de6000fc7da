//! The keys of every modelled network, with or without a board: its clock, and its script of events.

use std::path::PathBuf;

use crate::address::uri::{LinkUri, UriError};
use crate::recording::Clock;

/// Parses `clock=`: whether the modelled network runs on the real clock or on a virtual one.
pub(super) fn clock(uri: &LinkUri) -> Result<Clock, UriError> {
    uri.choice("clock", [("real", Clock::Real), ("virtual", Clock::Virtual)])
}

/// Parses `script=`: the file with events that happen to the network.
pub(super) fn script(uri: &LinkUri) -> Result<Option<PathBuf>, UriError> {
    uri.typed("script", |value| Some(PathBuf::from(value)))
}
