//! A finding: what was checked on this machine, whether it is right for a board, and what to do if not.

mod timing;

use std::fmt;

pub use timing::{lateness, lateness_of_own_cycles, timer};

/// Whether something is right for a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is right, or not needed.
    Fine,
    /// It works, and could be improved.
    Advice,
    /// It has to be corrected.
    Wrong,
}

impl Verdict {
    /// The name in the output of `ecmsk doctor`: `ok`, `advice` or `wrong`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fine => "ok",
            Self::Advice => "advice",
            Self::Wrong => "wrong",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The result of one check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The name of the check, which does not change between versions.
    pub check: &'static str,
    /// The device that was checked, such as `1-2.3` or `/dev/spidev0.0`; `None` if it is not about a device.
    pub subject: Option<String>,
    /// Whether it is right.
    pub verdict: Verdict,
    /// What was found, as a text.
    pub found: String,
    /// What to do about it; `None` if nothing has to be done.
    pub next: Option<String>,
    /// Whether the device cannot be opened because of it.
    pub blocks: bool,
    /// Measured values by their names, which contain the unit.
    pub figures: Vec<(&'static str, i64)>,
}

impl Finding {
    /// A finding that is right.
    pub fn fine(check: &'static str, found: impl Into<String>) -> Self {
        let found = found.into();
        Self { check, subject: None, verdict: Verdict::Fine, found, next: None, blocks: false, figures: Vec::new() }
    }

    /// A finding that could be improved by `next`.
    pub fn advice(check: &'static str, found: impl Into<String>, next: impl Into<String>) -> Self {
        Self { verdict: Verdict::Advice, next: Some(next.into()), ..Self::fine(check, found) }
    }

    /// A finding that is wrong and corrected by `next`.
    pub fn wrong(check: &'static str, found: impl Into<String>, next: impl Into<String>) -> Self {
        Self { verdict: Verdict::Wrong, next: Some(next.into()), ..Self::fine(check, found) }
    }

    /// A finding that is wrong if it `matters`, and otherwise only mentioned.
    pub fn wrong_if(matters: bool, check: &'static str, found: impl Into<String>, next: impl Into<String>) -> Self {
        if matters { Self::wrong(check, found, next) } else { Self::fine(check, found) }
    }

    /// Sets the device that was checked.
    #[must_use]
    pub fn of(mut self, subject: &str) -> Self {
        self.subject = Some(subject.to_owned());
        self
    }

    /// Marks that the device cannot be opened because of it.
    #[must_use]
    pub fn blocking(mut self) -> Self {
        self.blocks = true;
        self
    }

    /// Adds a measured value, whose name contains the unit.
    #[must_use]
    pub fn figure(mut self, name: &'static str, value: i64) -> Self {
        self.figures.push((name, value));
        self
    }
}
