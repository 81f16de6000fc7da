//! The URI that names a link.

/// placeholder
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("bad uri")]
pub struct UriError;
