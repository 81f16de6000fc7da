//! The keys that any modelled network has, with a board or without: its clock, and what happens to it.

use std::path::PathBuf;

use crate::address::uri::{LinkUri, UriError};
use crate::recording::Clock;

/// Whether the clock of a modelled network is the real one.
pub(super) fn clock(uri: &LinkUri) -> Result<Clock, UriError> {
    uri.choice("clock", [("real", Clock::Real), ("virtual", Clock::Virtual)])
}

/// The file of events that happen to it.
pub(super) fn script(uri: &LinkUri) -> Result<Option<PathBuf>, UriError> {
    uri.typed("script", |value| Some(PathBuf::from(value)))
}
