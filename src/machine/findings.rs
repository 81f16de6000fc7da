//! A finding: what was checked on this machine, whether it is right for a board, and what to do if not.

mod timing;

use std::fmt;

pub use timing::{lateness, lateness_of_own_cycles, timer};

/// The verdict of a check: whether what was checked is right for a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FindingVerdict {
    /// The setting is right, or the link that the user wants does not need it.
    Fine,
    /// The setting works and could be improved.
    Advice,
    /// The setting has to be corrected.
    Wrong,
}

impl FindingVerdict {
    /// The name of the verdict in the output of `ecmsk doctor`: `ok`, `advice` or `wrong`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fine => "ok",
            Self::Advice => "advice",
            Self::Wrong => "wrong",
        }
    }
}

impl fmt::Display for FindingVerdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The result of one check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The name of the check, which does not change between versions.
    pub check: &'static str,
    /// The device that was checked, such as `1-2.3` or `/dev/spidev0.0`; `None` if the check is not about a device.
    pub subject: Option<String>,
    /// Whether what was found is right, could be improved, or has to be corrected.
    pub verdict: FindingVerdict,
    /// What was found, as a text.
    pub found: String,
    /// The next step for the user; `None` if nothing has to be done.
    pub next: Option<String>,
    /// Whether this finding keeps the device from being opened.
    pub blocks: bool,
    /// Measured values, each with its name, which contains the unit.
    pub figures: Vec<(&'static str, i64)>,
}

impl Finding {
    /// A finding that needs no action.
    pub fn fine(check: &'static str, found: impl Into<String>) -> Self {
        let found = found.into();
        Self {
            check,
            subject: None,
            verdict: FindingVerdict::Fine,
            found,
            next: None,
            blocks: false,
            figures: Vec::new(),
        }
    }

    /// A finding about a setting that works and could be improved. `next` is the step that improves it.
    pub fn advice(check: &'static str, found: impl Into<String>, next: impl Into<String>) -> Self {
        Self { verdict: FindingVerdict::Advice, next: Some(next.into()), ..Self::fine(check, found) }
    }

    /// A finding about a setting that has to be corrected. `next` is the step that corrects it.
    pub fn wrong(check: &'static str, found: impl Into<String>, next: impl Into<String>) -> Self {
        Self { verdict: FindingVerdict::Wrong, next: Some(next.into()), ..Self::fine(check, found) }
    }

    /// If `matters`, a finding that something is wrong, with `next` as the step that corrects it; otherwise a finding
    /// that all is fine, without a next step. `matters` is whether the link that the user wants needs what is missing.
    pub fn wrong_if(matters: bool, check: &'static str, found: impl Into<String>, next: impl Into<String>) -> Self {
        if matters { Self::wrong(check, found, next) } else { Self::fine(check, found) }
    }

    /// Sets the device that was checked to `subject`.
    #[must_use]
    pub fn of(mut self, subject: &str) -> Self {
        self.subject = Some(subject.to_owned());
        self
    }

    /// Marks that this finding keeps the device from being opened.
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
