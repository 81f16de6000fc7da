//! Positions and axes of an open board as text: with the names and units of the machine file or of the options.

use ecmsk::ecm::Scale;

use super::axis_word::Units;
use super::session::Board;
use crate::machine_option::label;

impl Board {
    /// A position of an axis as text, and in units if the axis has any.
    pub fn in_units(&self, number: u8, counts: i32) -> (String, Option<f64>) {
        let slave = self.config.as_ref().and_then(|config| config.slaves.get(usize::from(number).checked_sub(1)?));
        let scale = slave.and_then(|slave| slave.axis()).map(|axis| axis.scale).filter(|scale| *scale != Scale::COUNTS);
        let unit = self.unit(number);
        match scale.map(|scale| scale.to_units(counts)) {
            Some(units) => (format!("{units}{unit} ({counts} counts)"), Some(units)),
            None => (counts.to_string(), None),
        }
    }

    /// The unit of an axis behind a number, with a blank, as the machine file has it; empty without one.
    pub fn unit(&self, slave: u8) -> String {
        let axis = self.units().axis(slave).filter(|_| !self.units().has_option(slave));
        axis.map_or_else(String::new, |axis| format!(" {}", axis.unit))
    }

    /// A distance on an axis as text, see [`in_units`](Self::in_units). It has no sign, whatever that of the counts per unit.
    pub fn distance_in_units(&self, number: u8, counts: u32) -> String {
        match self.in_units(number, i32::try_from(counts).unwrap_or(i32::MAX)) {
            (text, Some(_)) => text.trim_start_matches('-').to_owned(),
            (_, None) => format!("{counts} counts"),
        }
    }

    /// The names and units with which the axes and positions of a step are converted.
    pub fn units(&self) -> Units<'_> {
        Units { option: self.scales.as_ref(), numbers: self.number_scales.as_ref(), machine: self.machine.as_ref() }
    }

    /// The name of an axis in messages: that of the machine file, else the number of its slave.
    pub fn label(&self, slave: u8) -> String {
        label(self.machine.as_ref(), slave)
    }

    /// Adds to a result what the machine file knows of an axis: its name, and the unit of `position`.
    pub fn add_names(&self, slave: u8, json: &mut serde_json::Value) {
        if let Some(axis) = self.machine.as_ref().and_then(|machine| machine.axis_of(slave)) {
            json["name"] = axis.name.clone().into();
            if !self.units().has_option(slave) {
                json["unit"] = axis.unit.word().into();
            }
        }
    }
}
