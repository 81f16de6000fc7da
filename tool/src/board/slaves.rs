//! The operand that names the slaves of a step: `1,2` or `all`.

use ecmsk::ecm::Config;

use super::axis_word::{AxisWord, Units};
use super::error::BoardError;
use super::network::{find_axis, slaves_with_axis};

/// The slaves that the operand of a step names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SlaveList {
    /// All slaves that have an axis.
    All,
    /// The axes in the operand, given by slave number or by name.
    Some(Vec<AxisWord>),
}

impl SlaveList {
    /// Parses `1,2` or `all`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        if text.eq_ignore_ascii_case("all") {
            return Ok(Self::All);
        }
        let words = text.split(',').map(AxisWord::parse);
        words
            .collect::<Option<_>>()
            .map(Self::Some)
            .ok_or_else(|| "allowed: slaves from 1 to 40, e.g. 1,2, or all".into())
    }

    /// The axes of several lists, without duplicates and in the order of the lists: the slave number, and the word that
    /// names the axis.
    ///
    /// # Errors
    /// [`BoardError::NoSlave`] if the network has no slave with that number, [`BoardError::WrongKind`] if the slave has
    /// no axis, [`BoardError::Refused`] if the machine file has no axis with that name or if there is no axis at all.
    pub fn axes(
        lists: &[Self],
        network: &Config,
        what: &str,
        units: Units<'_>,
    ) -> Result<Vec<(u8, AxisWord)>, BoardError> {
        let mut axes: Vec<(u8, AxisWord)> = Vec::new();
        for list in lists {
            let named: Vec<AxisWord> = match list {
                Self::Some(named) => named.clone(),
                Self::All => slaves_with_axis(network).into_iter().map(AxisWord::Number).collect(),
            };
            for word in named {
                let slave = units.slave(what, &word)?;
                find_axis(network, what, slave)?;
                if axes.iter().all(|(other, _)| *other != slave) {
                    axes.push((slave, word));
                }
            }
        }
        if axes.is_empty() {
            return Err(BoardError::Refused {
                what: what.to_owned(),
                why: "the network has no axis".into(),
                next: "correct --slaves".into(),
            });
        }
        Ok(axes)
    }
}
