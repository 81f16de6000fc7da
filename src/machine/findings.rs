//! What is right or wrong with a machine for a board, and what to do about it.

mod timing;

use std::fmt;

pub use timing::{lateness, timer};

/// How it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// As it should be, or of no use here.
    Fine,
    /// It works, and would work better.
    Advice,
    /// It has to be put right.
    Wrong,
}

impl State {
    /// Its name: `ok`, `advice`, `wrong`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fine => "ok",
            Self::Advice => "advice",
            Self::Wrong => "wrong",
        }
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What was looked at: a name that stays.
    pub check: &'static str,
    /// Of which device: `1-2.3`, `/dev/spidev0.0`.
    pub subject: Option<String>,
    /// How it is.
    pub state: State,
    /// What is there.
    pub found: String,
    /// What to do; `None`: nothing.
    pub next: Option<String>,
    /// The device cannot be opened as it is.
    pub blocks: bool,
    /// Figures by their names, with units.
    pub figures: Vec<(&'static str, i64)>,
}

impl Finding {
    /// All is well.
    pub fn fine(check: &'static str, found: impl Into<String>) -> Self {
        let found = found.into();
        Self { check, subject: None, state: State::Fine, found, next: None, blocks: false, figures: Vec::new() }
    }

    /// It works, and this would make it better.
    pub fn advice(check: &'static str, found: impl Into<String>, next: impl Into<String>) -> Self {
        Self { state: State::Advice, next: Some(next.into()), ..Self::fine(check, found) }
    }

    /// It is wrong, and this puts it right.
    pub fn wrong(check: &'static str, found: impl Into<String>, next: impl Into<String>) -> Self {
        Self { state: State::Wrong, next: Some(next.into()), ..Self::fine(check, found) }
    }

    /// Wrong where that matters, else just said.
    pub fn wrong_if(matters: bool, check: &'static str, found: impl Into<String>, next: impl Into<String>) -> Self {
        if matters { Self::wrong(check, found, next) } else { Self::fine(check, found) }
    }

    /// Of that device, or file.
    #[must_use]
    pub fn of(mut self, subject: &str) -> Self {
        self.subject = Some(subject.to_owned());
        self
    }

    /// With it the device does not open.
    #[must_use]
    pub fn blocking(mut self) -> Self {
        self.blocks = true;
        self
    }

    /// With a figure, by its name and unit.
    #[must_use]
    pub fn figure(mut self, name: &'static str, value: i64) -> Self {
        self.figures.push((name, value));
        self
    }
}
