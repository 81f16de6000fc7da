//! The line on the screen that shows the axes.

use ecmsk::ecm::{Guard, SoftLimits};
use ecmsk::machine_file::MachineAxis;
use serde_json::json;

use super::axis::Doing;
use super::{HoldToRun, Jog, Jogged, WHAT};
use crate::board::{BoardError, statusword_text};
use crate::machine_option::in_unit;

impl<H: HoldToRun> Jog<'_, H> {
    /// Shows the axes on one line.
    pub fn show(&self) -> Result<(), BoardError> {
        let axes = self.axes.iter().map(|axis| self.axis_text(axis));
        let text = self.hand.trouble().into_iter().chain(axes).collect::<Vec<_>>().join(" | ");
        let text: String = text.chars().take(self.hand.width()).collect();
        let json = || {
            let axis = |axis: &Jogged| {
                json!({
                    "axis": axis.slave, "position_counts": self.snapshot.position(axis.slave),
                    "following_error_counts": self.following_error(axis), "state": words(axis.motion.doing()),
                })
            };
            json!({"verb": WHAT, "axes": self.axes.iter().map(axis).collect::<Vec<_>>()})
        };
        Ok(self.board.reporter.progress(text, json)?)
    }

    fn axis_text(&self, axis: &Jogged) -> String {
        let machine = self.board.units().axis(axis.slave);
        let shown = |counts: f64| machine.map_or_else(|| format!("{counts}"), |axis| in_unit(axis, counts));
        let at = f64::from(self.snapshot.position(axis.slave).unwrap_or_default());
        let state = match (axis.motion.doing(), self.end_of(axis)) {
            (Doing::Stands, Some(limit)) => limit,
            (doing, _) => words(doing).to_owned(),
        };
        let (label, error) = (self.board.label(axis.slave), shown(f64::from(self.following_error(axis))));
        let word = statusword_text(self.board.statusword(&self.snapshot, axis.slave));
        format!("axis {label}: {state} at {}, following error {error}, {word}", shown(at))
    }

    /// Why an axis at rest cannot go further; `None` if it is between its limits.
    fn end_of(&self, axis: &Jogged) -> Option<String> {
        let SoftLimits { min, max } = axis.limits;
        let at = axis.motion.target();
        let limit = if at >= max { max } else { min };
        let words = self.board.units().axis(axis.slave).map(|machine| limit_words(machine, limit, at >= max));
        match (words, self.board.guard) {
            (Some(words), _) if at == limit => Some(format!("stands at its limit, {words},")),
            (_, Guard::Within(way)) if at.abs_diff(axis.start) >= way => {
                Some(format!("stands {way} counts from its start, see --guard,"))
            }
            (Some(words), _) if at > max || at < min => {
                Some(format!("stands beyond its limit, {words}, and moves only back,"))
            }
            _ => None,
        }
    }

    /// The following error: the target that the board executes minus the actual position, in counts.
    fn following_error(&self, axis: &Jogged) -> i32 {
        let position = self.snapshot.position(axis.slave).unwrap_or_default();
        axis.sent.front().map_or(0, |target| target.wrapping_sub(position))
    }
}

/// A soft limit in the notation of the machine file: `max = 250.000 mm`. `is_upper`: the limit is the upper one in
/// counts, which is the lower one in units if the axis counts backwards.
fn limit_words(machine: &MachineAxis, limit: i32, is_upper: bool) -> String {
    let word = if is_upper == (machine.scale.counts_per_unit > 0.0) { "max" } else { "min" };
    format!("{word} = {}", in_unit(machine, limit.into()))
}

const fn words(doing: Doing) -> &'static str {
    match doing {
        Doing::Stands => "stands",
        Doing::Runs => "runs",
        Doing::Brakes => "brakes",
    }
}
