//! What is wrong with a field of a request or an answer.

use core::fmt;

/// A field has a value that the manuals do not allow, or that does not fit into the data segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Malformed {
    /// The field, as in `SDO_REQ operation`.
    pub field: &'static str,
    /// The value that is there.
    pub found: u32,
    /// What may be there.
    pub allowed: Allowed,
}

/// What a field may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Allowed {
    /// No more than this.
    AtMost(u32),
    /// No less than this.
    AtLeast(u32),
    /// From the first to the second number, both included.
    Between(u32, u32),
    /// In words, as in `0 write, 1 read`.
    Only(&'static str),
}

impl Malformed {
    /// `found` is none of what the words in `allowed` say.
    pub(super) const fn only(field: &'static str, found: u32, allowed: &'static str) -> Self {
        Self { field, found, allowed: Allowed::Only(allowed) }
    }

    /// The value if it is at most `most`.
    ///
    /// # Errors
    /// It is more.
    pub(super) fn at_most(field: &'static str, found: usize, most: usize) -> Result<usize, Self> {
        if found <= most {
            Ok(found)
        } else {
            Err(Self { field, found: saturated(found), allowed: Allowed::AtMost(saturated(most)) })
        }
    }

    /// The value if it is at least `least`.
    ///
    /// # Errors
    /// It is less.
    pub(super) fn at_least(field: &'static str, found: usize, least: usize) -> Result<usize, Self> {
        if found >= least {
            Ok(found)
        } else {
            Err(Self { field, found: saturated(found), allowed: Allowed::AtLeast(saturated(least)) })
        }
    }
}

/// No length of ours reaches 2^32; one that did would be shown as the largest number.
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
