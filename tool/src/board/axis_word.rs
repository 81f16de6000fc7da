//! Axes as the user names them on the command line: by slave number, or by their name in the machine file.

use ecmsk::ecm::{Scale, Scales};
use ecmsk::machine_file::{MachineAxis, MachineFile, Unit};

use super::error::BoardError;
use crate::machine_option::{in_unit, label};

/// The highest slave number behind a board.
pub const SLAVES_MAX: u8 = 40;

/// An axis as it is named on the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AxisWord {
    /// The number of the axis's slave, 1..=40 in network order.
    Number(u8),
    /// The axis's name in the machine file.
    Name(String),
}

impl AxisWord {
    /// Parses a number or a name; `None` if it is neither.
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        if text.chars().next()?.is_alphabetic() {
            return Some(Self::Name(text.to_owned()));
        }
        text.parse().ok().filter(|slave| (1..=SLAVES_MAX).contains(slave)).map(Self::Number)
    }

    /// Parses the operand that names a slave: its number, or the name of its axis.
    ///
    /// # Errors
    /// The text is neither; the error says what is allowed.
    pub fn of_slave(text: &str) -> Result<Self, String> {
        Self::parse(text)
            .ok_or_else(|| format!("allowed: 1 to {SLAVES_MAX}, or the name of an axis in the machine file"))
    }

    /// Whether the axis is given by its name, so that the machine file is needed to find its slave.
    pub const fn is_name(&self) -> bool {
        matches!(self, Self::Name(_))
    }

    /// The number of the axis's slave, from 1 in network order.
    ///
    /// # Errors
    /// [`BoardError::Refused`] if there is no machine file, or it has no such axis.
    pub fn slave(&self, what: &str, machine: Option<&MachineFile>) -> Result<u8, BoardError> {
        let name = match self {
            Self::Number(slave) => return Ok(*slave),
            Self::Name(name) => name,
        };
        let refused = |why: String, next: String| BoardError::Refused { what: what.to_owned(), why, next };
        let Some(machine) = machine else {
            let why = format!("axis `{name}` is no number from 1 to {SLAVES_MAX}, and there is no machine file");
            return Err(refused(why, "name its slave, or say --machine FILE".to_owned()));
        };
        machine.axis(name).map(|axis| axis.slave).ok_or_else(|| {
            let names: Vec<&str> = machine.axes.iter().map(|axis| &*axis.name).collect();
            let there = if names.is_empty() { "no axis".to_owned() } else { names.join(", ") };
            refused(format!("{} has no axis `{name}`", machine.path.display()), format!("it has {there}"))
        })
    }
}

/// The data for converting the axes and positions of a command line: counts per unit by slave number, and the names and
/// units of the machine file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Units<'a> {
    /// The value of `--counts-per-unit`.
    pub option: Option<&'a Scales>,
    /// The counts per unit for axes that are given by slave number: from `--counts-per-unit`, otherwise from the server
    /// of the link.
    pub numbers: Option<&'a Scales>,
    /// The machine file, which has the units of axes that are given by name.
    pub machine: Option<&'a MachineFile>,
}

impl<'a> Units<'a> {
    /// The axis of a slave in the machine file; `None` if there is no machine file or no such axis.
    pub fn axis(&self, slave: u8) -> Option<&'a MachineAxis> {
        self.machine?.axis_of(slave)
    }

    /// The slave number of an axis, from 1 in network order. An axis that is given by name always has the unit of the
    /// machine file, because `--counts-per-unit` would change the meaning of its positions. \[OURS]
    ///
    /// # Errors
    /// As [`AxisWord::slave`]; [`BoardError::Refused`] if `--counts-per-unit` has a value for an axis that is given by
    /// name.
    pub fn slave(&self, what: &str, word: &AxisWord) -> Result<u8, BoardError> {
        let slave = word.slave(what, self.machine)?;
        match self.axis(slave).filter(|_| word.is_name() && self.has_option(slave)) {
            None => Ok(slave),
            Some(axis) => Err(BoardError::Refused {
                what: what.to_owned(),
                why: format!(
                    "axis {} has its unit, {}, from the machine file, and --counts-per-unit is for axes that are named by their \
                     numbers",
                    axis.name, axis.unit
                ),
                next: format!("leave out --counts-per-unit, or name the axis {slave}"),
            }),
        }
    }

    /// Whether `--counts-per-unit` has a value for an axis.
    pub fn has_option(&self, slave: u8) -> bool {
        self.option.is_some_and(|scales| scales.has(slave))
    }

    /// The name of an axis in messages: its name in the machine file, else its slave number.
    pub fn label(&self, slave: u8) -> String {
        label(self.machine, slave)
    }

    /// A distance or a speed of an axis as text, in the unit of the machine file or else in counts. `counts` is above
    /// 0.
    pub fn way_text(&self, slave: u8, counts: f64) -> String {
        let axis = self.axis(slave).filter(|axis| !self.has_option(slave) && axis.unit != Unit::Counts);
        axis.map_or_else(
            || format!("{counts:.0} counts"),
            |axis| in_unit(axis, counts * axis.scale.counts_per_unit.signum()),
        )
    }

    /// The unit in which the user writes positions of an axis. For an axis that is given by slave number this is the
    /// unit of `--counts-per-unit` or counts, not the unit of the machine file. So old command lines keep their meaning
    /// when a machine file is added. \[OURS]
    pub fn scale(&self, word: &AxisWord, slave: u8) -> Scale {
        match self.axis(slave).filter(|_| word.is_name()) {
            Some(axis) => axis.scale,
            None => self.numbers.map_or(Scale::COUNTS, |scales| scales.of(slave)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_numbers_or_names() {
        assert_eq!(AxisWord::parse(" 40 "), Some(AxisWord::Number(40)));
        assert_eq!(AxisWord::parse("X2"), Some(AxisWord::Name("X2".to_owned())));
        for wrong in ["", "0", "41", "1x", "-1", "_"] {
            assert_eq!(AxisWord::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_name_has_the_unit_of_the_file_and_a_number_that_of_the_option() {
        let text = "format = 1\n[slaves.1]\nkind = \"none\"\n[axes]\nX = { slave = 2, unit = \"mm\", per = 0.5 }\n";
        let machine = MachineFile::parse("m.toml", text).unwrap();
        let (name, number) = (AxisWord::Name("x".to_owned()), AxisWord::Number(2));
        let units = Units { machine: Some(&machine), ..Units::default() };
        assert_eq!(name.slave("move", units.machine).unwrap(), 2);
        assert_eq!((units.scale(&name, 2), units.scale(&number, 2)), (Scale::per_unit(2.0), Scale::COUNTS));
        let scales = Scales::parse("7").unwrap();
        let units = Units { numbers: Some(&scales), ..units };
        assert_eq!(units.slave("move", &name).unwrap(), 2);
        for (option, refused) in [("7", true), ("2=7", true), ("1=7", false)] {
            let scales = Scales::parse(option).unwrap();
            let units = Units { option: Some(&scales), ..units };
            let slaves = [&name, &number].map(|word| units.slave("move", word).ok());
            assert_eq!(slaves, [(!refused).then_some(2), Some(2)], "{option}");
        }
        assert_eq!((units.scale(&name, 2), units.scale(&number, 2)), (Scale::per_unit(2.0), Scale::per_unit(7.0)));
        let unknown = AxisWord::Name("Y".to_owned());
        assert_eq!(
            unknown.slave("move", units.machine).unwrap_err().to_string(),
            "move: m.toml has no axis `Y`; it has X"
        );
        assert!(name.slave("move", None).unwrap_err().to_string().ends_with("or say --machine FILE"));
    }
}
