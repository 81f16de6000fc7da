//! The option `--fail-on`: the reasons for which a recorded run counts as failed.

use ecmsk::machine_file::{MachineAxis, MachineFile, Unit};
use ecmsk::summary::Summary;

use super::extremes::{AxisExtremes, named, seconds};
use crate::machine_option::number_and_unit;
use crate::motion::Quantity;

/// One reason of `--fail-on`, with its text.
#[derive(Clone, Debug, PartialEq)]
pub struct FailOn {
    /// The text of the reason on the command line.
    pub text: String,
    /// The parsed reason.
    pub reason: Reason,
}

/// A condition that makes a run fail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// Anything that the summary reports, or an incomplete recording.
    Any,
    /// A drive had an alarm.
    Alarm,
    /// An internal limit of a drive kept its axis away from its target.
    HeldBack,
    /// A state change of the network failed.
    State,
    /// An underrun made a gap in a motion.
    Gap,
    /// The magnitude of a value of any axis was above this limit, in the unit of the [`Quantity`].
    Above(Quantity, u64),
    /// The magnitude of a value was above this limit, for any axis that has this unit in the machine file. The limit is
    /// in this unit.
    AboveUnits(Quantity, f64, Unit),
}

impl FailOn {
    /// The reason `any`, for the option `--exit-code`: anything that went wrong.
    pub fn any() -> Self {
        Self { text: "any".to_owned(), reason: Reason::Any }
    }

    /// Parses one reason, e.g. `alarm` or `following-error>500`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        Ok(Self { text: text.trim().to_owned(), reason: Reason::parse(text)? })
    }

    /// Whether the reason is `any`. Only for `any`, a run also fails if its recording cannot be read at all.
    pub fn is_any(&self) -> bool {
        matches!(self.reason, Reason::Any)
    }
}

impl Reason {
    /// Parses a reason, as [`FailOn::parse`].
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let allowed = || {
            let quantities = Quantity::ALL.map(Quantity::word).join(">N, ");
            format!(
                "allowed: any, alarm, held-back, state, gap, {quantities}>PERCENT, several with commas; N is counts, or e.g. 0.5mm by the \
                 machine file"
            )
        };
        match text.trim() {
            "any" => return Ok(Self::Any),
            "alarm" => return Ok(Self::Alarm),
            "held-back" => return Ok(Self::HeldBack),
            "state" => return Ok(Self::State),
            "gap" => return Ok(Self::Gap),
            _ => {}
        }
        let (word, limit) = text.split_once('>').ok_or_else(allowed)?;
        let quantity = Quantity::ALL.into_iter().find(|quantity| quantity.word() == word.trim()).ok_or_else(allowed)?;
        if let Some(limit) = in_units(limit).filter(|_| quantity != Quantity::Torque) {
            return Ok(Self::AboveUnits(quantity, limit.0, limit.1));
        }
        let limit: f64 = limit.trim().trim_end_matches('%').trim().parse().map_err(|_| allowed())?;
        if !(0.0..=1e15).contains(&limit) {
            return Err(allowed());
        }
        let limit = if quantity == Quantity::Torque { limit * 10.0 } else { limit };
        Ok(Self::Above(quantity, whole(limit)))
    }

    /// The texts that say why the run has failed; empty if it has not failed for this reason.
    pub fn failures(
        self,
        summary: &Summary,
        is_whole: bool,
        axes: &[(usize, &AxisExtremes)],
        machine: Option<&MachineFile>,
    ) -> Vec<String> {
        let gaps = summary.counts().find(|(name, _)| *name == "gaps").map_or(0, |(_, count)| count);
        let if_any = |count: u64, what: &str| if count > 0 { vec![format!("{count} {what}")] } else { Vec::new() };
        match self {
            Self::Any if !is_whole => vec!["the recording is not whole".to_owned()],
            Self::Any => if_any(u64::from(!summary.is_empty()), "summary that is not empty"),
            Self::Alarm => if_any(summary.alarms().map(|(_, times)| times).sum(), "alarm(s)"),
            Self::HeldBack => if_any(summary.held_back().map(|(_, times)| times).sum(), "axis held back by its drive"),
            Self::State => if_any(summary.states_failed().map(|(_, times)| times).sum(), "failed change(s) of state"),
            Self::Gap => if_any(gaps, "gap(s) in a motion"),
            Self::Above(quantity, limit) => {
                axes.iter().filter_map(|axis| above(axis, quantity, machine, |_| Some(limit))).collect()
            }
            Self::AboveUnits(quantity, limit, unit) => {
                let counts = |axis: Option<&MachineAxis>| {
                    let axis = axis.filter(|axis| axis.unit == unit)?;
                    Some(whole(limit * axis.scale.counts_per_unit.abs()))
                };
                let failed: Vec<String> =
                    axes.iter().filter_map(|axis| above(axis, quantity, machine, counts)).collect();
                let has_unit = machine.is_some_and(|machine| machine.axes.iter().any(|axis| axis.unit == unit));
                // If no axis has the unit of the limit, the run fails: otherwise a wrong unit would pass every run.
                if has_unit { failed } else { vec![format!("no axis of a machine file is in {unit}; see --machine")] }
            }
        }
    }
}

/// The text of the failure if the peak value of an axis is above its limit; else `None`. `limit` returns `None` for an
/// axis whose unit in the machine file is not the unit of the limit.
fn above(
    (slave, extremes): &(usize, &AxisExtremes),
    quantity: Quantity,
    machine: Option<&MachineFile>,
    limit: impl Fn(Option<&MachineAxis>) -> Option<u64>,
) -> Option<String> {
    let (axis, label) = named(*slave, machine);
    let (limit, peak) = (limit(axis)?, extremes.of(quantity));
    let (name, value) = (quantity.word().replace('-', " "), quantity.shown(peak.value, axis));
    let limit = (peak.value > limit).then(|| quantity.shown(limit, axis))?;
    Some(format!("axis {label}: {name} {value} at {}, above {limit}", seconds(peak.at_ns)))
}

/// The largest whole number that is not above the limit, with a tolerance for rounding: a product such as 0.57 * 10000
/// is a little less than the exact number. \[OURS]
fn whole(limit: f64) -> u64 {
    let near = limit.round();
    if (limit - near).abs() <= 1e-9 * near.max(1.0) { near as u64 } else { limit.floor() as u64 }
}

/// Parses a limit with a unit: `0.5mm`, `100 mm/s`.
fn in_units(text: &str) -> Option<(f64, Unit)> {
    let text = text.trim();
    let text = text.strip_suffix("/s").unwrap_or(text);
    number_and_unit(text).filter(|(limit, unit)| *unit != Unit::Counts && (0.0..=1e15).contains(limit))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A limit in a unit is converted to the exact number of counts.
    #[test]
    fn limits_are_whole_counts() {
        for thousandths in 1..=3000_u32 {
            for counts_per_unit in [1000.0, 10_000.0, 1e6] {
                let limit: f64 = format!("{}.{:03}", thousandths / 1000, thousandths % 1000).parse().unwrap();
                let counts = f64::from(thousandths) * (counts_per_unit / 1000.0);
                assert_eq!(whole(limit * counts_per_unit), counts as u64, "{limit}");
            }
        }
        assert_eq!([0.0, 0.4, 0.999, 2.5, 1e15].map(whole), [0, 0, 0, 2, 1_000_000_000_000_000]);
    }

    #[test]
    fn reasons_are_read() {
        for (text, reason) in [
            ("any", Reason::Any),
            (" alarm", Reason::Alarm),
            ("held-back", Reason::HeldBack),
            ("following-error>500", Reason::Above(Quantity::FollowingError, 500)),
            ("torque > 80.5 %", Reason::Above(Quantity::Torque, 805)),
            ("velocity>0", Reason::Above(Quantity::Velocity, 0)),
            ("velocity>100 mm/s", Reason::AboveUnits(Quantity::Velocity, 100.0, Unit::Mm)),
            ("following-error>0.5deg", Reason::AboveUnits(Quantity::FollowingError, 0.5, Unit::Deg)),
        ] {
            assert_eq!(Reason::parse(text), Ok(reason), "{text}");
        }
        for text in [
            "",
            "alarms",
            "following-error",
            "following-error>x",
            "torque>-1",
            "jerk>3",
            "velocity>1e300",
            "torque>NaN",
            "torque>5mm",
            "velocity>-1mm/s",
            "velocity>NaNmm",
        ] {
            let error = Reason::parse(text).unwrap_err();
            assert!(
                error.starts_with("allowed: any, alarm, held-back, state, gap, following-error>N, "),
                "{text}: {error}"
            );
        }
    }
}
