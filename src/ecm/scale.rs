//! Units of positions. On the wire positions are counts; for an axis a program may set how many counts one of its units has.

/// The counts of one unit (mm, degree, turn); negative if the unit counts in the opposite direction.
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
    /// A unit is a count.
    pub const COUNTS: Self = Self::per_unit(1.0);

    /// A unit has that many counts.
    pub const fn per_unit(counts_per_unit: f64) -> Self {
        Self { counts_per_unit }
    }

    /// Whether it can be used: it is finite and not 0.
    pub fn is_valid(self) -> bool {
        self.counts_per_unit.is_finite() && self.counts_per_unit != 0.0
    }

    /// The nearest count; `None` if that does not fit the 32 bits of the wire, or `units` is no number.
    pub fn to_counts(self, units: f64) -> Option<i32> {
        let counts = (units * self.counts_per_unit).round();
        (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&counts).then_some(counts as i32)
    }

    /// The units of a count.
    pub fn to_units(self, counts: i32) -> f64 {
        f64::from(counts) / self.counts_per_unit
    }
}

impl Default for Scale {
    fn default() -> Self {
        Self::COUNTS
    }
}
