//! The operand with the slaves of a step: `1,2` or `all`.

use ecmsk::ecm::Config;

use super::error::BoardError;
use super::network::{find_axis, slaves_with_axis};

/// The slaves that the operand of a step names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SlaveList {
    /// All slaves that have an axis.
    All,
    /// The slaves with these numbers.
    Some(Vec<u8>),
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
        let numbers =
            text.split(',').map(|number| number.trim().parse().ok().filter(|number| (1..=40).contains(number)));
        numbers
            .collect::<Option<_>>()
            .map(Self::Some)
            .ok_or_else(|| "allowed: slaves from 1 to 40, e.g. 1,2, or all".into())
    }

    /// The axes in several lists, each once, in the order of the lists.
    ///
    /// # Errors
    /// [`BoardError::NoSlave`], [`BoardError::WrongKind`], [`BoardError::Refused`] if there is none.
    pub fn axes(lists: &[Self], network: &Config, what: &str) -> Result<Vec<u8>, BoardError> {
        let mut axes = Vec::new();
        for list in lists {
            let named: Vec<u8> = match list {
                Self::Some(named) => named.clone(),
                Self::All => slaves_with_axis(network),
            };
            for slave in named {
                find_axis(network, what, slave)?;
                if !axes.contains(&slave) {
                    axes.push(slave);
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
