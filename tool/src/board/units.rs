//! Positions and axes of an open board as text, with the names and units of the machine file or of the options.

use ecmsk::cia402::ErrorCode;
use ecmsk::ecm::Scale;

use super::axis_word::Units;
use super::session::Board;
use crate::machine_option::label;

/// Converts positions of an axis to text.
pub struct PositionText {
    /// The counts per unit; `None` if positions are shown in counts.
    scale: Option<Scale>,
    /// The unit that follows a number, with a leading space; may be empty.
    unit: String,
}

impl PositionText {
    /// A position as text, and as a number in units if the axis has units.
    pub fn of(&self, counts: i32) -> (String, Option<f64>) {
        let unit = &self.unit;
        match self.scale.map(|scale| scale.to_units(counts)) {
            Some(units) => (format!("{units}{unit} ({counts} counts)"), Some(units)),
            None => (counts.to_string(), None),
        }
    }
}

impl Board {
    /// A position of an axis as text, and as a number in units if the axis has units.
    pub fn in_units(&self, number: u8, counts: i32) -> (String, Option<f64>) {
        self.position_text(number).of(counts)
    }

    /// Returns the converter of positions of an axis to text.
    pub fn position_text(&self, number: u8) -> PositionText {
        let slave = self.config.as_ref().and_then(|config| config.slaves.get(usize::from(number).checked_sub(1)?));
        let scale = slave.and_then(|slave| slave.axis()).map(|axis| axis.scale).filter(|scale| *scale != Scale::COUNTS);
        PositionText { scale, unit: self.unit(number) }
    }

    /// The unit of an axis in the machine file, with a leading space, to follow a number; empty without a unit.
    pub fn unit(&self, slave: u8) -> String {
        let axis = self.units().axis(slave).filter(|_| !self.units().has_option(slave));
        axis.map_or_else(String::new, |axis| format!(" {}", axis.unit))
    }

    /// A distance on an axis as text, see [`in_units`](Self::in_units). It has no sign, even if the counts per unit are
    /// negative.
    pub fn distance_in_units(&self, number: u8, counts: u32) -> String {
        match self.in_units(number, i32::try_from(counts).unwrap_or(i32::MAX)) {
            (text, Some(_)) => text.trim_start_matches('-').to_owned(),
            (_, None) => format!("{counts} counts"),
        }
    }

    /// The names and units for converting the axes and positions of a step.
    pub fn units(&self) -> Units<'_> {
        Units { option: self.scales.as_ref(), numbers: self.number_scales.as_ref(), machine: self.machine.as_ref() }
    }

    /// The name of an axis in messages: its name in the machine file, else its slave number.
    pub fn label(&self, slave: u8) -> String {
        label(self.machine.as_ref(), slave)
    }

    /// Axes as text for messages: `axis X`, `axes X, 2`.
    pub fn labels(&self, slaves: &[u8]) -> String {
        let labels = slaves.iter().map(|slave| self.label(*slave)).collect::<Vec<_>>().join(", ");
        format!("{} {labels}", if slaves.len() == 1 { "axis" } else { "axes" })
    }

    /// The error code (0x603F) of a slave with its meaning, from the machine file or else from CiA 402.
    pub fn alarm_text(&self, slave: u8, code: u16) -> String {
        let of_file = self.machine.as_ref().and_then(|machine| machine.alarm_text(slave, code));
        of_file.map_or_else(|| ErrorCode(code).to_string(), |text| format!("0x{code:04X}: {text}"))
    }

    /// Adds to a JSON result what the machine file says about an axis: its name, and the unit of `position`.
    pub fn add_names(&self, slave: u8, json: &mut serde_json::Value) {
        if let Some(axis) = self.machine.as_ref().and_then(|machine| machine.axis_of(slave)) {
            json["name"] = axis.name.clone().into();
            if !self.units().has_option(slave) {
                json["unit"] = axis.unit.word().into();
            }
        }
    }
}
