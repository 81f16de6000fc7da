//! The error for an invalid field of a request or an answer.

use core::fmt;

/// A field has a value that the manuals do not allow, or does not fit into the data segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Malformed {
    /// The name of the field, as in `SDO_REQ operation`.
    pub field: &'static str,
    /// The value that the field has; for a field that is too long or too short its length in bytes.
    pub found: u32,
    /// The values that the field may have.
    pub allowed: Allowed,
}

/// The values that a field may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Allowed {
    /// At most this value.
    AtMost(u32),
    /// At least this value.
    AtLeast(u32),
    /// From the first to the second value, both included.
    Between(u32, u32),
    /// The allowed values as text, as in `0 write, 1 read`.
    Only(&'static str),
}

impl Malformed {
    /// The error that `found` is not one of the values that `allowed` describes.
    pub(super) const fn only(field: &'static str, found: u32, allowed: &'static str) -> Self {
        Self { field, found, allowed: Allowed::Only(allowed) }
    }

    /// Returns the value if it is at most `most`.
    ///
    /// # Errors
    /// The value is larger.
    pub(super) fn at_most(field: &'static str, found: usize, most: usize) -> Result<usize, Self> {
        if found <= most {
            Ok(found)
        } else {
            Err(Self { field, found: saturated(found), allowed: Allowed::AtMost(saturated(most)) })
        }
    }

    /// Returns the value if it is at least `least`.
    ///
    /// # Errors
    /// The value is smaller.
    pub(super) fn at_least(field: &'static str, found: usize, least: usize) -> Result<usize, Self> {
        if found >= least {
            Ok(found)
        } else {
            Err(Self { field, found: saturated(found), allowed: Allowed::AtLeast(saturated(least)) })
        }
    }
}

/// Converts a length for display. No length in this crate reaches 2^32; a larger one is shown as the maximum.
fn saturated(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { field, found, allowed } = self;
        write!(f, "{field} is {found} (0x{found:X}), allowed is {allowed}")
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtMost(most) => write!(f, "at most {most}"),
            Self::AtLeast(least) => write!(f, "at least {least}"),
            Self::Between(least, most) => write!(f, "{least} to {most}"),
            Self::Only(words) => f.write_str(words),
        }
    }
}

impl core::error::Error for Malformed {}
