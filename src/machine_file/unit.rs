//! The units of positions that an axis in a machine file may have.

use std::fmt;

use serde::Deserialize;

/// The unit of an axis's positions.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// Millimetres.
    Mm,
    /// Micrometres.
    Um,
    /// Metres.
    M,
    /// Inches.
    In,
    /// Degrees.
    Deg,
    /// Radians.
    Rad,
    /// Turns.
    Turn,
    /// Counts of the encoder.
    #[default]
    Counts,
}

impl Unit {
    /// All units, in the order of the documentation.
    pub const ALL: [Self; 8] = [Self::Mm, Self::Um, Self::M, Self::In, Self::Deg, Self::Rad, Self::Turn, Self::Counts];

    /// The word for the unit in a machine file and after a number, such as `mm`.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Um => "um",
            Self::M => "m",
            Self::In => "in",
            Self::Deg => "deg",
            Self::Rad => "rad",
            Self::Turn => "turn",
            Self::Counts => "counts",
        }
    }

    /// How many of this unit a full turn has; `None` for a unit that is no angle.
    pub const fn per_turn(self) -> Option<f64> {
        match self {
            Self::Deg => Some(360.0),
            Self::Rad => Some(std::f64::consts::TAU),
            Self::Turn => Some(1.0),
            _ => None,
        }
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}
