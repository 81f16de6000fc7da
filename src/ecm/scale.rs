//! Units: on the wire everything is counts; an axis may say how many counts one unit of yours is.

/// Counts of one unit (mm, degree, turn): negative if the unit counts the other way.
///
/// ```
/// use ecmsk::ecm::Scale;
///
/// let degrees = Scale::per_unit(131_072.0 / 360.0);
/// assert_eq!(degrees.to_counts(90.0), Some(32_768));
/// assert_eq!(degrees.to_units(-65_536), -180.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Counts of one unit; finite and not 0.
    pub counts_per_unit: f64,
}

impl Scale {
    /// The unit is the count.
    pub const COUNTS: Self = Self::per_unit(1.0);

    /// That many counts are one unit.
    pub const fn per_unit(counts_per_unit: f64) -> Self {
        Self { counts_per_unit }
    }

    /// Whether it can be used.
    pub fn is_valid(self) -> bool {
        self.counts_per_unit.is_finite() && self.counts_per_unit != 0.0
    }

    /// The nearest count; `None` if it does not fit into the 32 bits of the wire or is no number.
    pub fn to_counts(self, units: f64) -> Option<i32> {
        let counts = (units * self.counts_per_unit).round();
        (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&counts).then_some(counts as i32)
    }

    /// Counts in units.
    pub fn to_units(self, counts: i32) -> f64 {
        f64::from(counts) / self.counts_per_unit
    }
}

impl Default for Scale {
    fn default() -> Self {
        Self::COUNTS
    }
}
