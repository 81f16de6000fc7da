//! Units of positions. Frames have positions in counts. For each axis a program may set the number of counts in its unit.

/// The number of counts in one unit (mm, degree, turn); negative if the unit counts in the opposite direction.
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
    /// The number of counts in one unit; finite and not 0.
    pub counts_per_unit: f64,
}

impl Scale {
    /// A unit of one count.
    pub const COUNTS: Self = Self::per_unit(1.0);

    /// A unit of `counts_per_unit` counts.
    pub const fn per_unit(counts_per_unit: f64) -> Self {
        Self { counts_per_unit }
    }

    /// Whether the scale is finite and not 0.
    pub fn is_valid(self) -> bool {
        self.counts_per_unit.is_finite() && self.counts_per_unit != 0.0
    }

    /// Converts units to the nearest count; `None` if the result does not fit 32 bits, or `units` is NaN.
    pub fn to_counts(self, units: f64) -> Option<i32> {
        let counts = (units * self.counts_per_unit).round();
        (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&counts).then_some(counts as i32)
    }

    /// Converts counts to units.
    pub fn to_units(self, counts: i32) -> f64 {
        f64::from(counts) / self.counts_per_unit
    }
}

impl Default for Scale {
    fn default() -> Self {
        Self::COUNTS
    }
}
