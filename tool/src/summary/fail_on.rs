//! The option `--fail-on`: which findings make a run fail.

use ecmsk::summary::Summary;

use super::extremes::{AxisExtremes, Quantity, seconds};

/// A kind of finding that makes a run fail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FailOn {
    /// Any finding of the summary, or an incomplete recording.
    Any,
    /// A drive had an alarm.
    Alarm,
    /// A change of the network's state failed.
    State,
    /// An underrun made a gap in a motion.
    Gap,
    /// A value of any axis above this limit, which is in the unit of the [`Quantity`].
    Above(Quantity, u64),
}

impl FailOn {
    /// Reads one reason, e.g. `alarm` or `following-error>500`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let allowed = || {
            let quantities = Quantity::ALL.map(Quantity::word).join(">N, ");
            format!("allowed: any, alarm, state, gap, {quantities}>PERCENT, several with commas")
        };
        match text.trim() {
            "any" => return Ok(Self::Any),
            "alarm" => return Ok(Self::Alarm),
            "state" => return Ok(Self::State),
            "gap" => return Ok(Self::Gap),
            _ => {}
        }
        let (word, limit) = text.split_once('>').ok_or_else(allowed)?;
        let quantity = Quantity::ALL.into_iter().find(|quantity| quantity.word() == word.trim()).ok_or_else(allowed)?;
        let limit: f64 = limit.trim().trim_end_matches('%').trim().parse().map_err(|_| allowed())?;
        if !(0.0..=1e15).contains(&limit) {
            return Err(allowed());
        }
        let limit = if quantity == Quantity::Torque { limit * 10.0 } else { limit };
        Ok(Self::Above(quantity, limit.floor() as u64))
    }

    /// The lines that say why the run has failed; none if it has not.
    pub fn failures(self, summary: &Summary, is_whole: bool, axes: &[(usize, &AxisExtremes)]) -> Vec<String> {
        let gaps = summary.counts().find(|(name, _)| *name == "gaps").map_or(0, |(_, count)| count);
        let if_any = |count: u64, what: &str| if count > 0 { vec![format!("{count} {what}")] } else { Vec::new() };
        match self {
            Self::Any if !is_whole => vec!["the recording is not whole".to_owned()],
            Self::Any => if_any(u64::from(!summary.is_empty()), "summary that is not empty"),
            Self::Alarm => if_any(summary.alarms().map(|(_, times)| times).sum(), "alarm(s)"),
            Self::State => if_any(summary.states_failed().map(|(_, times)| times).sum(), "failed change(s) of state"),
            Self::Gap => if_any(gaps, "gap(s) in a motion"),
            Self::Above(quantity, limit) => axes
                .iter()
                .map(|(slave, extremes)| (slave, extremes.of(quantity)))
                .filter(|(_, peak)| peak.value > limit)
                .map(|(slave, peak)| {
                    let (name, value) = (quantity.word().replace('-', " "), quantity.shown(peak.value));
                    format!("axis {slave}: {name} {value} at {}, above {}", seconds(peak.at_ns), quantity.shown(limit))
                })
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_are_read() {
        for (text, reason) in [
            ("any", FailOn::Any),
            (" alarm", FailOn::Alarm),
            ("following-error>500", FailOn::Above(Quantity::FollowingError, 500)),
            ("torque > 80.5 %", FailOn::Above(Quantity::Torque, 805)),
            ("velocity>0", FailOn::Above(Quantity::Velocity, 0)),
        ] {
            assert_eq!(FailOn::parse(text), Ok(reason), "{text}");
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
        ] {
            let error = FailOn::parse(text).unwrap_err();
            assert!(error.starts_with("allowed: any, alarm, state, gap, following-error>N, "), "{text}: {error}");
        }
    }
}
