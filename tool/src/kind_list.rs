//! Parses lists of slave kinds, for `--kinds` and `--slaves` of the verbs that show frames.

use ecmsk::link::slaves;
use ecmsk::sk::SlaveKind;

/// Kinds of slaves in the order of the network, as `--kinds` has them: `drive*2,io`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KindList(Vec<SlaveKind>);

impl KindList {
    /// The kinds in the order of the network, slave 1 first.
    pub fn kinds(&self) -> &[SlaveKind] {
        &self.0
    }

    /// Parses a list of kinds. What other lists of slaves allow after a kind, such as the mode in `drive:csv`, is ignored.
    ///
    /// # Errors
    /// The text is invalid; the error says what is wrong and what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        slaves::parse_declared(text, |kind, _| Ok(kind)).map(Self)
    }

    /// The help of an option with kinds, between the words `begin` and `end`.
    pub fn help(begin: &str, end: &str) -> String {
        format!("{begin}, e.g. drive*2,io; of {}{end}", slaves::declared_words())
    }
}
