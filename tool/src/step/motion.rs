//! `move`: moves axes to positions, all together, with limited speed, acceleration and jerk.

mod duration;
pub mod internal_limit;
mod path;
mod target;

use std::time::Duration;

use ecmsk::cia402::Mode;
use ecmsk::ecm::{Config, EcmError, Guard, Scale, Snapshot, Stream, StreamStats};
use ecmsk::sk::{SlotSize, StateByte};
use serde_json::json;

use super::profile::{PathPoint, Profile};
use crate::board::{Board, BoardError, NEAR_COUNTS, Needs, Units, find_axis, in_mode, numbered, positive};
use duration::Asked;
use internal_limit::Watched;
pub use path::{AskedSpeeds, Speeds};
use path::{AxisPath, Path};
use target::outside;
pub use target::{AxisTarget, Jerk, Target, check_limits, counts};

const WHAT: &str = "move";
/// \[OURS] How far ahead of their execution targets are sent to the FIFO. If the program is late by less than this, the motion
/// has no gap.
const AHEAD: Duration = Duration::from_millis(64);
/// \[OURS] The limits of the number of frames ahead, which apply instead of [`AHEAD`] for very short and very long cycles.
const DEPTHS: std::ops::RangeInclusive<u64> = 8..=150;
/// \[OURS] How long axes may take to settle after the last target, and (next constant) how far from it they may be, in counts.
const SETTLE_LIMIT: Duration = Duration::from_millis(500);
const SETTLE_WINDOW_COUNTS: u32 = 2;
/// \[OURS] If an internal limit of its drive holds an axis away from its target for this long, the move fails. The time is more
/// than twice that of the frames ahead, so the reports already answer the present targets.
pub const HELD_LIMIT: Duration = Duration::from_millis(150);
/// \[OURS] The time limit for braking after Ctrl-C. The tool promises to end within 2 s after Ctrl-C; the rest of that time
/// is for closing the board.
pub const BRAKE_LIMIT: Duration = Duration::from_millis(1500);

/// Move axes to positions, all together
///
/// The axes start and arrive at the same time, on a straight line, with bounded speed, acceleration and jerk (CSP). Ctrl-C
/// brakes on that line, within 2 s; the axes stay on.
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
    /// Checks the counts per unit: if `--counts-per-unit` names single axes, it has to name each axis of the move.
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

    /// Like [`Args::check_units`], for the counts per unit of this move's own command line: they must not name an axis that the
    /// move does not have.
    ///
    /// # Errors
    /// An axis has no unit, or there is a unit for another axis.
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

    /// The targets, each with the slave and the scale that its axis and its unit have.
    fn resolved(&self, units: Units<'_>) -> Result<Vec<AxisTarget>, BoardError> {
        self.targets.iter().map(|target| target.resolve(WHAT, units)).collect()
    }

    /// Checks the move before anything is sent.
    ///
    /// # Errors
    /// A slave has no axis in CSP, or is named twice. A target does not fit into 32 bits or is beyond the limits of the
    /// axis. At this velocity the targets in the FIFO are so far ahead of the axis that its `--lead-limit` ends the move.
    pub fn check(&self, network: &Config, units: Units<'_>) -> Result<(), BoardError> {
        let targets = self.resolved(units)?;
        for (index, target) in targets.iter().enumerate() {
            let slave = target.slave;
            if targets[..index].iter().any(|other| other.slave == slave) {
                return Err(refused(format!("axis {slave} is named twice"), "name each axis once"));
            }
            let axis = find_axis(network, WHAT, slave)?;
            in_mode(slave, WHAT, axis, Mode::Csp)?;
            let counts = counts(WHAT, target)?;
            if !self.relative {
                check_limits(WHAT, units, slave, counts)?;
            }
            let (velocity, ahead) = (self.speeds(target, units)?.velocity, f64::from(depth(network)));
            let behind = velocity * ahead * f64::from(network.cycle_us) * 1e-6;
            if let Guard::Within(limit) = axis.guard
                && behind > f64::from(limit)
            {
                let why = format!(
                    "at {velocity} counts/s the target of axis {slave} runs {behind:.0} counts ahead of it, the limit is {limit}"
                );
                return Err(refused(why, "lower --velocity, or widen --lead-limit"));
            }
        }
        Ok(())
    }

    /// The velocity, acceleration and jerk limits of an axis, in counts and seconds: those of the options, else of the
    /// machine file, else defaults.
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
        // Commands that are still in the FIFO may move the axes, so their execution is awaited before the path is planned.
        board.run_interruptible("waiting for a standstill", |ecm| ecm.stream(depth)?.finish())?;
        let lost_before = board.ecm.snapshot()?.state().is_failed();
        let cycle = f64::from(config.cycle_us) * 1e-6;
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
                let why = format!("axis {} is {off} counts off its target", axis.slave);
                return Err(if after.state().is_failed() && !lost_before {
                    lost(board, after.state())
                } else if internal_limit::is_limited(board, &after, axis.slave) {
                    refused(format!("{why}: {}", internal_limit::WHY), internal_limit::NEXT)
                } else {
                    refused(why, "see its load, its limits and its tuning, or move slower")
                });
            }
        }
        Ok(())
    }

    /// Moves the axes along their path. After a gap longer than [`GAP_MAX`] (the FIFO was empty) they start again from
    /// rest. Returns the duration in seconds, the number of underruns, and the path of the last part, which ends at the
    /// targets.
    fn carry_out(
        &self,
        board: &Board,
        depth: u16,
        cycle: f64,
        lost_before: bool,
    ) -> Result<(f64, u64, Path), BoardError> {
        let (mut snapshot, mut path) = self.agreed_path(board)?;
        let held_limit_s = HELD_LIMIT.as_secs_f64().max(2.0 * f64::from(depth) * cycle);
        let (mut seconds, mut underruns) = (0.0, 0);
        loop {
            let stream = board.ecm.stream(depth).map_err(|error| board.explain(error))?;
            let moved = Run { board, path: &path, snapshot: &snapshot, lost_before, cycle, held_limit_s }.go(stream);
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

    /// The path, and the report that it begins at. A long path is returned only if the user agrees to it.
    fn agreed_path(&self, board: &Board) -> Result<(Snapshot, Path), BoardError> {
        let snapshot = board.ecm.snapshot()?;
        let path = self.path(board, &snapshot)?;
        if duration::announce(board, &path, self.yes)? == Asked::No {
            return Ok((snapshot, path));
        }
        // While the user took time to answer, an axis may have been turned by hand or got an alarm.
        board.ready(WHAT, Needs::On(&self.slaves(board)?))?;
        let snapshot = board.ecm.snapshot()?;
        let path = self.path(board, &snapshot)?;
        Ok((snapshot, path))
    }

    /// The numbers of the slaves that the targets name.
    fn slaves(&self, board: &Board) -> Result<Vec<u8>, BoardError> {
        Ok(self.resolved(board.units())?.iter().map(|target| target.slave).collect())
    }

    /// The path from the present positions to the targets.
    fn path(&self, board: &Board, snapshot: &Snapshot) -> Result<Path, BoardError> {
        let axis = |target: &AxisTarget| {
            let start = board.standing_position(snapshot, target.slave);
            let end = counts(WHAT, target)?;
            let end = if self.relative { start.checked_add(end) } else { Some(end) };
            let end = end.ok_or_else(|| outside(WHAT, target))?;
            check_limits(WHAT, board.units(), target.slave, end)?;
            if let Guard::Within(limit) = board.guard
                && end.abs_diff(start) > limit
            {
                let (slave, way) = (target.slave, end.abs_diff(start));
                let why = format!("axis {slave} is at {start}, and {end} is {way} counts away; --guard allows {limit}");
                return Err(refused(why, "name a nearer target, or widen --guard"));
            }
            Ok(AxisPath { slave: target.slave, start, end, speeds: self.speeds(target, board.units())? })
        };
        let axes: Vec<AxisPath> = self.resolved(board.units())?.iter().map(axis).collect::<Result<_, BoardError>>()?;
        Path::new(axes).map_err(no_path)
    }
}

/// Prints the positions of the axes after a failed move.
fn note_positions(board: &Board, path: &Path) -> Result<(), BoardError> {
    let after = board.ecm.snapshot()?;
    for axis in &path.axes {
        if let Some(position) = after.position(axis.slave) {
            board.reporter.note(format_args!("axis {} is at {position}", axis.slave));
        }
    }
    Ok(())
}

/// The error for a board that has lost a slave during the motion. Reports do not show which one: the link may know it.
pub fn lost(board: &Board, found: StateByte) -> BoardError {
    let slave = board.link_stats().state_failure.and_then(|failure| failure.slave());
    board.explain(EcmError::SlaveLost { slave, found })
}

fn no_path(why: String) -> BoardError {
    refused(why, "choose a speed and an acceleration nearer to each other")
}

/// \[OURS] After a gap longer than this the axes start again from rest. After a shorter one they continue at their speed:
/// otherwise a program that is often slightly late would never finish a move.
const GAP_MAX: Duration = Duration::from_millis(100);

/// \[OURS] In how many further cycles the last targets are sent again. The drives settle meanwhile.
pub const HOLD_FRAMES: usize = 9;

/// How the motion along a path has ended, with its duration in seconds.
enum Ended {
    /// The last targets were sent to all axes, or Ctrl-C has braked the motion. In the latter case [`Run::go`] returns an
    /// error instead.
    Arrived(f64),
    /// The FIFO was empty for too long, so the axes stand. The second value is the fraction of the path that they have covered,
    /// 0 to 1.
    Stood(f64, f64),
}

/// The motion along one path.
struct Run<'a> {
    board: &'a Board,
    path: &'a Path,
    snapshot: &'a Snapshot,
    /// Whether the board had lost a slave before the move, which does not end the move then.
    lost_before: bool,
    /// The cycle time in seconds.
    cycle: f64,
    /// How long an internal limit may hold an axis away from its target, in seconds.
    held_limit_s: f64,
}

impl Run<'_> {
    /// Sends one target per cycle until all axes have arrived, or until a gap that is longer than [`GAP_MAX`]. Returns how
    /// the move ended, and the counters of the stream.
    fn go(&self, mut stream: Stream<'_>) -> Result<(Ended, StreamStats), BoardError> {
        let stepped = self.steps(&mut stream);
        // `finish` brakes axes that are still moving, also after an error.
        let finished = stream.finish();
        let ended = stepped?;
        self.board.check_stop()?;
        Ok((ended, finished.map_err(|error| self.board.explain(error))?))
    }

    fn steps(&self, stream: &mut Stream<'_>) -> Result<Ended, BoardError> {
        let Some(profile) = &self.path.profile else { return Ok(Ended::Arrived(0.0)) };
        let mut pace = self.board.reporter.pace();
        let (mut last, mut before, mut gap) = (PathPoint::default(), 0, 0_u64);
        let mut watched: Vec<Watched> = self.path.axes.iter().map(|axis| Watched::new(axis.slave)).collect();
        for frame in 1_u64.. {
            let time = frame as f64 * self.cycle;
            if self.board.interrupt.signal().is_some() {
                self.brake(stream, last)?;
                return Ok(Ended::Arrived(time));
            }
            let now = stream.snapshot().map_err(|error| self.board.explain(error))?;
            if now.state().is_failed() && !self.lost_before {
                self.brake(stream, last)?;
                return Err(lost(self.board, now.state()));
            }
            if let Some((slave, at)) = self.held_axis(&now, &mut watched, last, time) {
                self.brake(stream, last)?;
                return Err(refused(
                    format!("axis {slave} stands at {at}: {}", internal_limit::WHY),
                    internal_limit::NEXT,
                ));
            }
            last = profile.at(time);
            let done = time >= profile.seconds();
            let stats =
                self.step(stream, false, |axis| if done { axis.end } else { axis.at(last.length / self.path.length) })?;
            if done {
                self.hold(stream, false, |axis| axis.end)?;
                return Ok(Ended::Arrived(time));
            }
            // A long gap may become known over several steps, so the underruns of all steps are added up. Each step sends one
            // target, so one cycle is subtracted per step: single underruns far apart do not add up to a long gap.
            gap = (gap + stats.underruns - std::mem::replace(&mut before, stats.underruns)).saturating_sub(1);
            if gap as f64 * self.cycle > GAP_MAX.as_secs_f64() {
                return Ok(Ended::Stood(time, last.length / self.path.length));
            }
            if pace.due(Duration::from_secs_f64(time)) {
                let (all, part) = (profile.seconds(), time / profile.seconds());
                let text = format!("moving, {:.0} %, {time:.1} of {all:.1} s", part * 100.0);
                self.board.reporter.part(part, text, || json!({"verb": WHAT, "progress": part, "seconds": time}))?;
            }
        }
        Ok(Ended::Arrived(0.0))
    }

    /// The first axis that an internal limit of its drive has held back for too long, with its position; `None` if there is
    /// none.
    fn held_axis(&self, now: &Snapshot, watched: &mut [Watched], last: PathPoint, time: f64) -> Option<(u8, i32)> {
        for (axis, watched) in self.path.axes.iter().zip(watched) {
            let target = axis.at(last.length / self.path.length);
            if watched.held_for(self.board, now, target, time) >= self.held_limit_s {
                return Some((axis.slave, now.position(axis.slave).unwrap_or_default()));
            }
        }
        None
    }

    /// Brakes along the path, from its point `last` on. A lost slave takes no targets, and the others are braked all the same.
    fn brake(&self, stream: &mut Stream<'_>, last: PathPoint) -> Result<(), BoardError> {
        let brake = Profile::to_rest(last, self.path.limits, BRAKE_LIMIT);
        let brake = brake.map_err(|why| refused(why, "the axes hold their last targets"))?;
        for frame in 1_u64.. {
            let time = frame as f64 * self.cycle;
            let along = brake.at(time).length / self.path.length;
            self.step(stream, true, |axis| axis.at(along))?;
            if time >= brake.seconds() {
                return self.hold(stream, true, |axis| axis.at(along));
            }
        }
        Ok(())
    }

    /// Repeats the last targets, so that the drives reach them.
    fn hold(&self, stream: &mut Stream<'_>, brakes: bool, at: impl Fn(&AxisPath) -> i32) -> Result<(), BoardError> {
        (0..HOLD_FRAMES).try_for_each(|_| self.step(stream, brakes, &at).map(drop))
    }

    /// Sends a target to each axis. `brakes`: lost slaves are left out; otherwise they are errors.
    fn step(
        &self,
        stream: &mut Stream<'_>,
        brakes: bool,
        at: impl Fn(&AxisPath) -> i32,
    ) -> Result<StreamStats, BoardError> {
        let explain = |error| self.board.explain(error);
        for axis in &self.path.axes {
            match aim(self.board, self.snapshot, stream, axis.slave, at(axis)) {
                Err(EcmError::SlaveLost { .. }) if brakes => {}
                aimed => aimed.map_err(explain)?,
            }
        }
        stream.step().map_err(explain)
    }
}

/// Sets the target of an axis. With 16-byte slots one command moves both channels of an HSP (a pulse module), so the second
/// channel gets its position in `snapshot`, the report before the motion, and stands still.
pub fn aim(
    board: &Board,
    snapshot: &Snapshot,
    stream: &mut Stream<'_>,
    slave: u8,
    target: i32,
) -> Result<(), EcmError> {
    match snapshot.slave(slave) {
        Some(ecmsk::ecm::SlaveView::Hsp(hsp)) if board.ecm.slot_size()? == SlotSize::Bytes16 => {
            let of = |target| ecmsk::sk::AxisTarget { target, outputs: 0 };
            stream.csp_hsp(slave, of(target), of(hsp.second.position))
        }
        _ => stream.csp(slave, target),
    }
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
        let (slave, counts) = (axis.slave, axis.off(&now));
        board
            .reporter
            .note(format_args!("axis {slave} is {counts} counts off its target; see its load and its tuning"));
    }
    Ok(now)
}

/// The number of frames that are sent ahead of their execution.
pub fn depth(network: &Config) -> u16 {
    let frames = AHEAD.as_micros() as u64 / u64::from(network.cycle_us.max(1));
    frames.clamp(*DEPTHS.start(), *DEPTHS.end()) as u16
}

fn refused(why: String, next: &str) -> BoardError {
    BoardError::Refused { what: WHAT.into(), why, next: next.into() }
}
