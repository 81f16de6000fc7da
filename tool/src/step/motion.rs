//! `move`: moves axes to positions, all of them at the same time, with limited speed, acceleration and jerk.

mod duration;
pub mod internal_limit;
mod path;
mod run;
mod target;

use std::time::Duration;

use ecmsk::cia402::Mode;
use ecmsk::ecm::{Config, Guard, Scale, Snapshot};
use serde_json::json;

use super::frames::{Frames, check_lead, depth, held_limit_s, lost};
use crate::board::{Board, BoardError, NEAR_COUNTS, Needs, Units, find_axis, in_mode, numbered, positive};
use duration::Asked;
pub use path::{AskedSpeeds, Speeds};
use path::{AxisPath, Path};
use run::{Ended, Run};
use target::outside;
pub use target::{AxisTarget, Jerk, Target, check_limits, counts};

const WHAT: &str = "move";
/// \[OURS] How long axes may take to settle after the last target, and (next constant) the distance from the target
/// that counts as settled, in counts.
const SETTLE_LIMIT: Duration = Duration::from_millis(500);
const SETTLE_WINDOW_COUNTS: u32 = 2;

/// Move axes to positions, all together
///
/// The axes start and arrive at the same time, on a straight line, with bounded speed, acceleration and jerk (CSP). Ctrl-C
/// brakes on that line, within 2 s; the axes stay on, unless this program is the board itself (nic:, xf-spi:, xf-usb:).
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk move 1=10000 2=-5000 --velocity 20000 --link 'sim:?slaves=drive*2' --up
  ecmsk move 1=12.5 --velocity 5 --counts-per-unit 10000 --link 'sim:?slaves=drive' --up
  ecmsk move X=12.5 Y=-3 --velocity 5 --machine machine.toml --up")]
pub struct Args {
    /// The axes and their targets. By the numbers of their slaves: whole counts, or units with --counts-per-unit. By their
    /// names in the machine file: units of the axis, also X=12.5mm or X=500counts. Units are rounded to the nearest count
    #[arg(value_name = "AXIS=TARGET", required = true, value_parser = Target::parse)]
    targets: Vec<Target>,

    /// Targets are distances from the present positions
    #[arg(long)]
    relative: bool,

    /// Speed of the fastest axis at most, units a second [default: 10000 counts a second]
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true)]
    velocity: Option<f64>,

    /// Acceleration, units a second squared [default: reaches the speed in 0.2 s]
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true)]
    acceleration: Option<f64>,

    /// Jerk, units a second cubed, or off [default: reaches the acceleration in 0.1 s]
    #[arg(long, value_name = "N|off", value_parser = Jerk::parse, allow_negative_numbers = true)]
    jerk: Option<Jerk>,

    /// Do not ask, at a terminal, before a move of more than a minute
    #[arg(long)]
    yes: bool,
}

impl Args {
    /// Checks `--counts-per-unit`: if it gives values for single axes, it must give one for each axis of the move.
    ///
    /// # Errors
    /// An axis has no value.
    pub fn check_units(&self, units: Units<'_>) -> Result<(), BoardError> {
        let targets = self.resolved(units)?;
        let mut in_counts = targets.iter().map(|target| target.scale == Scale::COUNTS);
        let has_speed = self.velocity.is_some() || self.acceleration.is_some() || self.jerk.is_some();
        if units.machine.is_some() && has_speed && in_counts.clone().any(|is| is) && !in_counts.all(|is| is) {
            let why = "some targets are in counts and others in units, so a speed would have two units".to_owned();
            return Err(refused(why, "name all axes alike, or leave out --velocity, --acceleration and --jerk"));
        }
        let Some(scales) = units.option else { return Ok(()) };
        match targets.iter().find(|target| !target.is_named && !scales.has(target.slave)) {
            None => Ok(()),
            Some(AxisTarget { slave, .. }) => {
                let why = format!("--counts-per-unit says nothing of axis {slave}, which would move in counts");
                let next = format!("add its counts per unit, or {slave}=1 if its target is in counts");
                Err(refused(why, &next))
            }
        }
    }

    /// Like [`Args::check_units`], for a `--counts-per-unit` on the command line of this move: it must not give a value
    /// for an axis that is not part of the move.
    ///
    /// # Errors
    /// An axis of the move has no value, or there is a value for another axis.
    pub fn check_only_units(&self, units: Units<'_>) -> Result<(), BoardError> {
        self.check_units(units)?;
        let slaves: Vec<u8> = self.resolved(units)?.iter().map(|target| target.slave).collect();
        let of = |axis: &u8| slaves.contains(axis);
        match units.option.and_then(|scales| scales.axes().find(|axis| !of(axis))) {
            None => Ok(()),
            Some(axis) => {
                let why =
                    format!("--counts-per-unit names axis {axis}, the move {}", numbered("axis", "axes", &slaves));
                Err(refused(why, "name the same axes in both, or one number for all: --counts-per-unit N"))
            }
        }
    }

    /// The targets, each with its slave number and the scale of its unit.
    fn resolved(&self, units: Units<'_>) -> Result<Vec<AxisTarget>, BoardError> {
        self.targets.iter().map(|target| target.resolve(WHAT, units)).collect()
    }

    /// Checks the move before anything is sent.
    ///
    /// # Errors
    /// A slave has no axis in CSP, or is named twice. A target does not fit into 32 bits, or is beyond the soft limits
    /// of the axis. The velocity is so high that `--lead-limit` would end the move, see [`check_lead`].
    pub fn check(&self, network: &Config, units: Units<'_>) -> Result<(), BoardError> {
        let targets = self.resolved(units)?;
        for (index, target) in targets.iter().enumerate() {
            let slave = target.slave;
            if targets[..index].iter().any(|other| other.slave == slave) {
                return Err(refused(format!("axis {} is named twice", units.label(slave)), "name each axis once"));
            }
            let axis = find_axis(network, WHAT, slave)?;
            in_mode(&units.label(slave), WHAT, axis, Mode::Csp)?;
            let counts = counts(WHAT, target, units)?;
            if !self.relative {
                check_limits(WHAT, units, slave, counts)?;
            }
            check_lead(WHAT, network, slave, axis, self.speeds(target, units)?.velocity, units)?;
        }
        Ok(())
    }

    /// The velocity, acceleration and jerk limits of an axis, in counts and seconds. They come from the options, else
    /// from the machine file, else from defaults.
    ///
    /// # Errors
    /// An option is above the limit of the axis in the machine file.
    fn speeds(&self, target: &AxisTarget, units: Units<'_>) -> Result<Speeds, BoardError> {
        let asked = AskedSpeeds { velocity: self.velocity, acceleration: self.acceleration, jerk: self.jerk };
        asked.of_axis(WHAT, target.slave, target.scale, units)
    }

    /// Moves the axes to their targets, and prints their positions.
    ///
    /// # Errors
    /// [`BoardError`] if a slave does not exist or has no axis in CSP, an axis is not enabled or does not follow, a target
    /// or a limit is not allowed, the board does not answer, or a signal stops the move.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        let slaves = self.slaves(board)?;
        board.ready(WHAT, Needs::On(&slaves))?;
        board.check_adopted(WHAT, &slaves)?;
        let config = board.known_network(WHAT)?;
        let depth = depth(config);
        // Commands that are still in the FIFO may move the axes, so the path is planned only after they were executed.
        board.run_interruptible("waiting for a standstill", |ecm| ecm.stream(depth)?.finish())?;
        let lost_before = board.ecm.snapshot()?.state().is_failed();
        let cycle = f64::from(config.cycle_us) * 1e-6;
        self.note_rounded(board)?;
        let (seconds, underruns, path) = self.carry_out(board, depth, cycle, lost_before)?;
        if underruns > 0 {
            board.reporter.note(format_args!("{underruns} cycles found no target in the board: the motion had gaps"));
        }
        let after = settled(board, &path)?;
        for axis in &path.axes {
            board.note_target(axis.slave, axis.end);
            let position = after.position(axis.slave).unwrap_or_default();
            let (text, units) = board.in_units(axis.slave, position);
            let mut json = json!({
                "verb": WHAT, "axis": axis.slave, "target_counts": axis.end, "position_counts": position,
                "seconds": seconds, "underruns": underruns,
            });
            if let Some(units) = units {
                json["position"] = units.into();
            }
            board.add_names(axis.slave, &mut json);
            board.reporter.result(format_args!("axis {}: at {text}", board.label(axis.slave)), &json)?;
        }
        for axis in &path.axes {
            let off = axis.off(&after);
            if off > NEAR_COUNTS {
                let (label, off) = (board.label(axis.slave), board.distance_in_units(axis.slave, off));
                let why = format!("axis {label} is {off} off its target");
                return Err(if after.state().is_failed() && !lost_before {
                    lost(board, after.state())
                } else if internal_limit::is_limited(board, &after, axis.slave) || board.was_limited(axis.slave) {
                    refused(format!("{why}: {}", internal_limit::WHY), internal_limit::NEXT)
                } else {
                    refused(why, "see its load, its limits and its tuning, or move slower")
                });
            }
        }
        Ok(())
    }

    /// Moves the axes along their path. After a gap that has stopped the axes (the FIFO was empty) they start again
    /// from rest. Returns the duration in seconds, the number of underruns, and the path since the last start, which
    /// ends at the targets.
    fn carry_out(
        &self,
        board: &Board,
        depth: u16,
        cycle: f64,
        lost_before: bool,
    ) -> Result<(f64, u64, Path), BoardError> {
        let (mut snapshot, mut path) = self.agreed_path(board)?;
        let held_limit_s = held_limit_s(depth, cycle);
        let (mut seconds, mut underruns) = (0.0, 0);
        loop {
            let frames = Frames::begin(board, snapshot, depth, cycle)?;
            let moved = Run { board, path: &path, lost_before, cycle, held_limit_s }.go(frames);
            board.reporter.clear();
            let (ended, stats) = match moved {
                Ok(moved) => moved,
                Err(error) => {
                    note_positions(board, &path)?;
                    return Err(error);
                }
            };
            underruns += stats.underruns;
            match ended {
                Ended::Arrived(s) => return Ok((seconds + s, underruns, path)),
                Ended::Stood(s, part) => {
                    seconds += s;
                    board
                        .reporter
                        .note(format_args!("this process was late, and the axes stood: they go on from rest"));
                    snapshot = board.ecm.snapshot()?;
                    path = path.resumed(part).map_err(no_path)?;
                }
            }
        }
    }

    /// Returns the path and the report from which it was planned. For a long path the user is asked first, and no path
    /// is returned without consent.
    fn agreed_path(&self, board: &Board) -> Result<(Snapshot, Path), BoardError> {
        let snapshot = board.ecm.snapshot()?;
        let path = self.path(board, &snapshot)?;
        if duration::announce(board, &path, self.yes)? == Asked::No {
            return Ok((snapshot, path));
        }
        // While the user was answering, an axis may have been turned by hand or an alarm may have occurred. So the axes
        // are checked and the path is planned again.
        board.ready(WHAT, Needs::On(&self.slaves(board)?))?;
        let snapshot = board.ecm.snapshot()?;
        let path = self.path(board, &snapshot)?;
        Ok((snapshot, path))
    }

    /// Prints a note for each target that changes when it is rounded to whole counts.
    fn note_rounded(&self, board: &Board) -> Result<(), BoardError> {
        for target in self.resolved(board.units())? {
            let Some(place) = target.scale.rounds_to(target.value) else { continue };
            let (label, value, count) = (board.label(target.slave), target.value, target.scale.count());
            let unit = board.unit(target.slave);
            board.reporter.note(format_args!(
                "axis {label}: {value}{unit} is rounded to {place}{unit}, since a count is {count}{unit}"
            ));
        }
        Ok(())
    }

    /// The slave numbers of the axes of this move.
    fn slaves(&self, board: &Board) -> Result<Vec<u8>, BoardError> {
        Ok(self.resolved(board.units())?.iter().map(|target| target.slave).collect())
    }

    /// The path from the present positions to the targets.
    fn path(&self, board: &Board, snapshot: &Snapshot) -> Result<Path, BoardError> {
        let axis = |target: &AxisTarget| {
            let start = board.standing_position(snapshot, target.slave);
            let end = counts(WHAT, target, board.units())?;
            let end = if self.relative { start.checked_add(end) } else { Some(end) };
            let end = end.ok_or_else(|| outside(WHAT, target, board.units()))?;
            check_limits(WHAT, board.units(), target.slave, end)?;
            if let Guard::Within(limit) = board.guard
                && end.abs_diff(start) > limit
            {
                let slave = target.slave;
                let [way, limit] = [end.abs_diff(start), limit].map(|counts| board.distance_in_units(slave, counts));
                let [start, goal] = [start, end].map(|counts| board.in_units(slave, counts).0);
                let axis = board.label(slave);
                let why = format!("axis {axis} is at {start}, and {goal} is {way} away; --guard allows {limit}");
                return Err(refused(why, "name a nearer target, or widen --guard"));
            }
            Ok(AxisPath { slave: target.slave, start, end, speeds: self.speeds(target, board.units())? })
        };
        let axes: Vec<AxisPath> = self.resolved(board.units())?.iter().map(axis).collect::<Result<_, BoardError>>()?;
        Path::new(axes).map_err(no_path)
    }
}

/// Prints a note with the position of each axis, after a failed move.
fn note_positions(board: &Board, path: &Path) -> Result<(), BoardError> {
    let after = board.ecm.snapshot()?;
    for axis in &path.axes {
        if let Some(position) = after.position(axis.slave) {
            let at = board.in_units(axis.slave, position).0;
            board.reporter.note(format_args!("axis {} is at {at}", board.label(axis.slave)));
        }
    }
    Ok(())
}

fn no_path(why: String) -> BoardError {
    refused(why, "choose a speed and an acceleration nearer to each other")
}

/// Waits until all axes are at their targets or [`SETTLE_LIMIT`] has passed. Returns the latest report.
fn settled(board: &Board, path: &Path) -> Result<Snapshot, BoardError> {
    let mut now = board.ecm.snapshot()?;
    let end = now.meta.at.0 + SETTLE_LIMIT.as_nanos() as u64;
    while path.axes.iter().any(|axis| axis.off(&now) > SETTLE_WINDOW_COUNTS) && now.meta.at.0 < end {
        board.check_stop()?;
        now = board.ecm.next_cycle(board.options.read_limit)?;
    }
    for axis in path.axes.iter().filter(|axis| axis.off(&now) > SETTLE_WINDOW_COUNTS) {
        let (label, off) = (board.label(axis.slave), board.distance_in_units(axis.slave, axis.off(&now)));
        board.reporter.note(format_args!("axis {label} is {off} off its target; see its load and its tuning"));
    }
    Ok(now)
}

fn refused(why: String, next: &str) -> BoardError {
    BoardError::Refused { what: WHAT.into(), why, next: next.into() }
}
