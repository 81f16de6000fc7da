//! Units of positions. On the wire positions are counts. A program, an option or a machine file may set for each axis how
//! many counts its unit has, and between which counts its targets have to be.

/// If rounding to the nearest count moves a position by more than this part of its value, the scale is probably wrong.
/// \[OURS] A scale that fits its axis moves positions by much less, and an inverted scale by more.
const ROUNDED_PART_MAX: f64 = 0.1;

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
    /// The unit is one count.
    pub const COUNTS: Self = Self::per_unit(1.0);

    /// The scale of a unit that has `counts_per_unit` counts.
    pub const fn per_unit(counts_per_unit: f64) -> Self {
        Self { counts_per_unit }
    }

    /// Whether the scale is finite and not 0.
    pub fn is_valid(self) -> bool {
        self.counts_per_unit.is_finite() && self.counts_per_unit != 0.0
    }

    /// Converts units to the nearest count; `None` if that does not fit 32 bits, or `units` is not a number.
    pub fn to_counts(self, units: f64) -> Option<i32> {
        let counts = (units * self.counts_per_unit).round();
        (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&counts).then_some(counts as i32)
    }

    /// Detects a scale whose counts are too long for its axis. If rounding to the nearest count moves a position by
    /// more than a tenth of its value, returns the rounded position in units. `None` if the position moves less, or
    /// does not fit 32 bits.
    ///
    /// ```
    /// use ecmsk::ecm::Scale;
    ///
    /// // A count of 1000 mm, where 0.001 mm was meant.
    /// assert_eq!(Scale::per_unit(0.001).rounds_to(250.0), Some(0.0));
    /// assert_eq!(Scale::per_unit(1000.0).rounds_to(250.0), None);
    /// ```
    pub fn rounds_to(self, units: f64) -> Option<f64> {
        // Adding 0.0 turns -0.0 into 0.0, so that messages show no minus sign.
        let rounded = self.to_units(self.to_counts(units)?) + 0.0;
        ((rounded - units).abs() > units.abs() * ROUNDED_PART_MAX).then_some(rounded)
    }

    /// The length of a count, in units; not below 0.
    pub fn count(self) -> f64 {
        1.0 / self.counts_per_unit.abs()
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

/// The positions between which the targets of an axis have to be, both ends included, in counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SoftLimits {
    /// The lowest allowed position, counts.
    pub min: i32,
    /// The highest allowed position, counts; not below `min`.
    pub max: i32,
}

impl SoftLimits {
    /// Every position is allowed.
    pub const NONE: Self = Self { min: i32::MIN, max: i32::MAX };

    /// How far a position is beyond the limits, counts: above 0 beyond `max`, below 0 beyond `min`, and 0 within them.
    pub const fn excess(self, position_counts: i32) -> i64 {
        if position_counts < self.min {
            position_counts as i64 - self.min as i64
        } else if position_counts > self.max {
            position_counts as i64 - self.max as i64
        } else {
            0
        }
    }

    /// Whether a target that is `excess` counts beyond the limits leads no further out than an axis that is `known` counts
    /// beyond them: on the same side, and no farther.
    pub(crate) const fn is_covered(excess: i64, known: i64) -> bool {
        excess == 0 || known.signum() == excess.signum() && known.abs() >= excess.abs()
    }

    /// Whether a position is within the limits.
    pub const fn contains(self, position_counts: i32) -> bool {
        self.min <= position_counts && position_counts <= self.max
    }
}

impl Default for SoftLimits {
    fn default() -> Self {
        Self::NONE
    }
}

/// How many counts one unit has: scales by axis number, and scales with `None`, which apply to all other axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Scales(Vec<(Option<u8>, Scale)>);

impl Scales {
    /// Parses `5000` or `1=5000,2=131072/360`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let item = |item: &str| {
            let (axis, number) = match item.split_once('=') {
                Some((axis, number)) => (Some(axis.trim().parse().ok().filter(|axis| *axis > 0)?), number),
                None => (None, item),
            };
            let scale = Scale::per_unit(fraction(number)?);
            scale.is_valid().then_some((axis, scale))
        };
        text.split(',').map(item).collect::<Option<_>>().map(Self).ok_or_else(|| {
            "allowed: a number that is not 0, or a fraction, for all axes or AXIS=N for some, e.g. 1=5000,2=131072/360"
                .into()
        })
    }

    /// Whether an axis has a scale, either of its own or the one for all axes.
    pub fn has(&self, axis: u8) -> bool {
        self.0.iter().any(|(of, _)| of.is_none_or(|of| of == axis))
    }

    /// The axes with a scale of their own.
    pub fn axes(&self) -> impl Iterator<Item = u8> {
        self.0.iter().filter_map(|(of, _)| *of)
    }

    /// The scale of an axis; without one positions are in counts.
    pub fn of(&self, axis: u8) -> Scale {
        let own = self.0.iter().rev().find(|(of, _)| *of == Some(axis));
        own.or_else(|| self.0.iter().rev().find(|(of, _)| of.is_none())).map_or(Scale::COUNTS, |(_, scale)| *scale)
    }
}

/// The value of a number or of a fraction of two numbers: `0.5`, `131072/360`.
pub(crate) fn fraction(text: &str) -> Option<f64> {
    let (over, under) = text.split_once('/').unwrap_or((text, "1"));
    let number = |text: &str| text.trim().parse::<f64>().ok();
    Some(number(over)? / number(under)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// If a count is long, rounding to the nearest count moves a position far.
    #[test]
    fn a_long_count_leads_to_another_place() {
        let long = Scale::per_unit(-0.001);
        for (units, place) in [
            (0.0, None),
            (250.0, Some(0.0)),
            (-400.0, Some(0.0)),
            (700.0, Some(1000.0)),
            (10_400.0, None),
            (1e300, None),
        ] {
            assert_eq!(long.rounds_to(units), place, "{units}");
        }
        let degrees = Scale::per_unit(131_072.0 / 360.0);
        assert_eq!([45.1, 0.02, 0.001].map(|units| degrees.rounds_to(units).is_some()), [false, false, true]);
        assert_eq!(long.count(), 1000.0);
    }

    /// A scale is a number or a fraction, for all axes or for one.
    #[test]
    fn counts_per_unit_are_numbers_or_fractions_of_all_axes_or_of_one() {
        let scales = Scales::parse("2=131072/4,5000").unwrap();
        assert_eq!([1, 2].map(|axis| scales.of(axis).counts_per_unit), [5000.0, 32768.0]);
        assert_eq!(Scales::parse("1=-10").unwrap().of(1), Scale::per_unit(-10.0));
        assert_eq!(Scales::parse("1=-10").unwrap().of(2), Scale::COUNTS);
        assert_eq!([1, 2].map(|axis| Scales::parse("1=-10").unwrap().has(axis)), [true, false]);
        assert_eq!((scales.has(7), scales.axes().collect::<Vec<_>>()), (true, vec![2]));
        for wrong in ["", "0", "1=", "0=5", "1/0", "x", "inf", "1=2=3"] {
            assert!(Scales::parse(wrong).is_err(), "{wrong}");
        }
    }
}
