//! Jogging: axes run as long as a person holds a key of a terminal (`ecmsk jog`), or a button of the page of
//! `ecmsk serve web --control`.
//!
//! Files: `keyboard.rs` reads which key of the terminal is held, with `dead_man.rs`, which decides which key counts as
//! held, `line.rs`, which measures how late keys arrive, `terminal.rs`, which reads the keys, and `keys.rs`, which decodes
//! their bytes. `axis.rs` is the motion of an axis, and `screen.rs` shows the axes.

mod axis;
mod dead_man;
mod keyboard;
#[cfg(unix)]
mod keys;
mod line;
mod screen;
mod terminal;

use std::collections::VecDeque;
use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use ecmsk::cia402::Mode;
use ecmsk::ecm::{Snapshot, SoftLimits};

use super::OnBoard;
use super::frames::{Frames, check_lead, depth, held_limit_s, lost};
use super::motion::internal_limit::{self, Watched};
use super::motion::{AskedSpeeds, Jerk, Speeds};
use crate::board::{
    AxisWord, Board, BoardError, BoardUse, Interrupt, Needs, StepSource, duration, find_axis, in_mode, positive,
};
use axis::{Doing, JogAxis, tap, within_guard};
use dead_man::Times;
use keyboard::{KEYS, Keyboard};

const WHAT: &str = "jog";
/// \[OURS] How long the first repeat of a held key may take, and (next constant) each further repeat; see [`Times`].
const FIRST_REPEAT: &str = "400ms";
const REPEAT: &str = "150ms";
/// The allowed range of these two times.
const REPEAT_RANGE: std::ops::RangeInclusive<Duration> = Duration::from_millis(30)..=Duration::from_secs(2);
/// \[OURS] The highest speed in a machine file is for programs. By hand, an axis moves with a tenth of it by default.
const PART_OF_MAX: f64 = 0.1;

/// A hold-to-run control: what a person holds so that an axis moves.
pub trait HoldToRun {
    /// What is held at present. Called in each cycle, so it returns at once.
    ///
    /// # Errors
    /// The control can no longer be read; all axes are braked.
    fn held(&mut self) -> Result<Held, BoardError>;

    /// This process has stalled until now, and the axes have stopped. What was held before does not count.
    fn stalled(&mut self);

    /// Why nothing counts as held at present, for the person; `None` if all is well.
    fn trouble(&self) -> Option<String>;

    /// The longest text that can be shown, in characters.
    fn width(&self) -> usize;
}

/// What is held of a [`HoldToRun`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// Nothing; all axes stand.
    Nothing,
    /// This axis runs; all others stand.
    Runs(JogMotion),
    /// All axes are braked, and jogging ends.
    End,
}

/// The motion of one axis that is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JogMotion {
    /// The index of the axis in the order in which the axes are named.
    pub axis: usize,
    /// Whether the axis moves in the positive direction of its unit.
    pub is_positive: bool,
}

/// Move axes by hand: hold a key and the axis runs, release it and the axis stops
///
/// A terminal reports a key again and again while it is held, and not its release. So an axis brakes when its key has not
/// arrived again in time, also if the line to the terminal stalls; keys that arrive late do not count. Terminals with kitty's
/// keyboard protocol report releases of arrow keys, too. Any other key stops, q ends. An axis stops at its limits in the
/// machine file; beyond one it moves only back. With --guard it goes no further than that from where it began.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Keys:
  the first axis has the arrows left and right, the second one down and up, the third one - and +; one axis alone has all;
  right, up and + move it to greater positions in its unit

Examples:
  ecmsk jog X Y --link tcp://localhost --up
  ecmsk jog 1 --velocity 2000 --link 'sim:?slaves=drive*2' --up")]
pub struct Args {
    /// One to three axes, by the numbers of their slaves or by their names in the machine file
    #[arg(value_name = "AXIS", required = true, num_args = 1..=3, value_parser = axis_word)]
    axes: Vec<AxisWord>,

    /// Speed, units a second [default: a tenth of max_velocity of the machine file, else 10000 counts a second]
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true)]
    velocity: Option<f64>,

    /// Acceleration, units a second squared [default: reaches the speed in 0.2 s]
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true)]
    acceleration: Option<f64>,

    /// Jerk, units a second cubed, or off [default: reaches the acceleration in 0.1 s]
    #[arg(long, value_name = "N|off", value_parser = Jerk::parse, allow_negative_numbers = true)]
    jerk: Option<Jerk>,

    /// How long the first repeat of a key may be missing until its axis brakes: longer than the keyboard waits with it
    #[arg(long, value_name = "TIME", value_parser = repeat_time, default_value = FIRST_REPEAT)]
    first_repeat: Duration,

    /// How long each further repeat may be missing
    #[arg(long, value_name = "TIME", value_parser = repeat_time, default_value = REPEAT)]
    repeat: Duration,

    /// Move axes also over a line to the terminal that is not measured, so that keys may count that come late
    #[arg(long)]
    any_line: bool,
}

fn axis_word(text: &str) -> Result<AxisWord, String> {
    AxisWord::parse(text).ok_or_else(|| "allowed: a slave from 1 to 40, or a name in the machine file".into())
}

fn repeat_time(text: &str) -> Result<Duration, String> {
    duration(text).ok().filter(|time| REPEAT_RANGE.contains(time)).ok_or_else(|| "allowed: 30ms to 2s".into())
}

/// Opens the board, moves axes by hand until a key or a signal ends this, and closes the board.
///
/// # Errors
/// [`BoardError`] if there is no terminal, the board cannot be opened, an axis is not enabled or fails, or a signal
/// arrives.
pub fn run(args: OnBoard<Args>) -> Result<(), BoardError> {
    let OnBoard { step, board } = args;
    if !io::stdin().is_terminal() || !io::stderr().is_terminal() {
        let why =
            "standard input and standard error have to be a terminal, whose keys are held and released".to_owned();
        return Err(refused(why, "run it in a terminal, or move axes with `ecmsk move`"));
    }
    let board = Board::open(&board, BoardUse::Moves, StepSource::CommandLine, Interrupt::watch()?)?;
    let done = step.run(&board);
    board.close(done)
}

/// An axis that is jogged, with the data for its part of the screen line.
struct Jogged {
    slave: u8,
    motion: JogAxis,
    /// Whether positive positions, in the unit of the command line, mean positive counts.
    counts_up: bool,
    /// The position of the axis when jogging began, in counts.
    start: i32,
    /// The soft limits of the machine file.
    limits: SoftLimits,
    held: Watched,
    /// The latest targets, at most as many as frames are buffered. The board is executing the oldest one.
    sent: VecDeque<i32>,
}

impl Args {
    fn run(&self, board: &Board) -> Result<(), BoardError> {
        let jogged = self.prepare(board, false)?;
        // A motion that the profile generator cannot plan is left out here; it is refused when its key is pressed.
        let taps = jogged.axes.iter().filter_map(|axis| {
            let way = tap(axis.motion.speeds(), self.first_repeat.as_secs_f64(), jogged.cycle).ok()?;
            let way = board.distance_in_units(axis.slave, way.unsigned_abs());
            Some(format!("axis {} by about {way}", board.label(axis.slave)))
        });
        let taps = taps.collect::<Vec<_>>().join(", ");
        let shorter = "--velocity and --first-repeat make that shorter";
        board.reporter.note(format_args!("one tap of a key moves {taps}; {shorter}"));
        self.say_keys(board, &jogged.axes);
        let times = Times { first: self.first_repeat, repeat: self.repeat };
        let mut keyboard = Keyboard::open(board, jogged.axes.len(), times, self.any_line)?;
        let done = jogged.follow(board, &mut keyboard);
        board.reporter.clear();
        done
    }

    /// Jogs one axis, by the number of its slave, as long as `hand` holds it. Its speed is that part of the default
    /// speed, 0 to 1. `is_checked`: the axis was jogged before, and nothing else was done on the board since, so its mode
    /// and the cycle time are not asked for again.
    ///
    /// # Errors
    /// [`BoardError`] if the axis is not enabled, cannot be jogged or fails, or if `hand` does.
    #[cfg_attr(not(feature = "web"), allow(dead_code, reason = "only the page uses it"))]
    pub fn jog_one(
        board: &Board,
        slave: u8,
        part: f64,
        is_checked: bool,
        hand: &mut impl HoldToRun,
    ) -> Result<(), BoardError> {
        // As the page shows it: in the unit of the machine file, whose positive direction may mean falling counts.
        let units = board.units();
        let word = match units.axis(slave).filter(|_| units.option.is_none()) {
            Some(axis) => AxisWord::Name(axis.name.clone()),
            None => AxisWord::Number(slave),
        };
        let mut args = Self {
            axes: vec![word.clone()],
            velocity: None,
            acceleration: None,
            jerk: None,
            first_repeat: Duration::ZERO,
            repeat: Duration::ZERO,
            any_line: false,
        };
        let whole = args.speeds(board, &word, slave)?.velocity;
        args.velocity = Some(part * whole / board.units().scale(&word, slave).counts_per_unit.abs());
        args.prepare(board, is_checked)?.follow(board, hand)
    }

    /// Checks the axes, and waits until all buffered commands were executed.
    ///
    /// # Errors
    /// [`BoardError`] if an axis cannot be jogged, is not enabled, or has an alarm.
    fn prepare(&self, board: &Board, is_checked: bool) -> Result<Prepared, BoardError> {
        let units = board.units();
        let mut slaves = Vec::new();
        let mut asked = Vec::new();
        for word in &self.axes {
            let slave = units.slave(WHAT, word)?;
            if slaves.contains(&slave) {
                return Err(refused(format!("axis {} is named twice", units.label(slave)), "name each axis once"));
            }
            let config = board.known_network(WHAT)?;
            let axis = find_axis(config, WHAT, slave)?;
            in_mode(&units.label(slave), WHAT, axis, Mode::Csp)?;
            let speeds = self.speeds(board, word, slave)?;
            check_lead(WHAT, config, slave, axis, speeds.velocity, units)?;
            slaves.push(slave);
            asked.push((speeds, units.scale(word, slave).counts_per_unit > 0.0));
        }
        if board.ecm.link_info().virtual_time {
            let why = "the board is on a virtual clock, which no hand can follow".to_owned();
            return Err(refused(why, "leave clock=virtual out of its link"));
        }
        board.ready(WHAT, Needs::On(&slaves))?;
        if !is_checked {
            board.check_adopted(WHAT, &slaves)?;
        }
        let config = board.known_network(WHAT)?;
        let depth = depth(config);
        // Commands that are still in the FIFO may move the axes, so jogging begins only after they were executed.
        board.run_interruptible("waiting for a standstill", |ecm| ecm.stream(depth)?.finish())?;
        let snapshot = board.ecm.snapshot()?;
        let axes = slaves.iter().zip(asked).map(|(slave, (speeds, counts_up))| {
            let limits = units.axis(*slave).map_or(SoftLimits::NONE, |axis| axis.limits);
            let start = board.standing_position(&snapshot, *slave);
            let motion = JogAxis::new(start, speeds, within_guard(limits, start, board.guard));
            let (held, sent) = (Watched::new(*slave), VecDeque::new());
            Jogged { slave: *slave, motion, counts_up, start, limits, held, sent }
        });
        Ok(Prepared { axes: axes.collect(), snapshot, depth, cycle: f64::from(config.cycle_us) * 1e-6 })
    }

    fn speeds(&self, board: &Board, word: &AxisWord, slave: u8) -> Result<Speeds, BoardError> {
        let units = board.units();
        let scale = units.scale(word, slave);
        let of_machine = units.axis(slave).and_then(|axis| {
            let of_file = axis.max_velocity? * axis.scale.counts_per_unit.abs() * PART_OF_MAX;
            Some(of_file / scale.counts_per_unit.abs())
        });
        let velocity = self.velocity.or(of_machine);
        AskedSpeeds { velocity, acceleration: self.acceleration, jerk: self.jerk }.of_axis(WHAT, slave, scale, units)
    }

    fn say_keys(&self, board: &Board, axes: &[Jogged]) {
        let label = |slave| format!("axis {}", board.label(slave));
        let keys: Vec<String> = match axes {
            [axis] => vec![format!("left or -, and right or +, move {}", label(axis.slave))],
            axes => {
                let of = |(axis, (_, _, keys)): (&Jogged, (_, _, &str))| format!("{keys} move {}", label(axis.slave));
                axes.iter().zip(KEYS).map(of).collect()
            }
        };
        board.reporter.note(format_args!("{}; any other key stops, q ends", keys.join(", ")));
    }
}

/// Axes that are ready to be jogged: enabled, and at rest.
struct Prepared {
    axes: Vec<Jogged>,
    /// The last report before the motion.
    snapshot: Snapshot,
    /// The number of buffered frames.
    depth: u16,
    /// The cycle time in seconds.
    cycle: f64,
}

impl Prepared {
    /// Moves the axes as `hand` holds them, until it or a signal ends that; then brakes them.
    fn follow(self, board: &Board, hand: &mut impl HoldToRun) -> Result<(), BoardError> {
        let Self { axes, snapshot, depth, cycle } = self;
        let frames = Frames::begin(board, snapshot.clone(), depth, cycle)?;
        let held_limit_s = held_limit_s(depth, cycle);
        let mut jog = Jog { board, axes, hand, began: Instant::now(), snapshot, cycle, depth, held_limit_s };
        let done = jog.go(frames);
        for axis in &jog.axes {
            board.note_target(axis.slave, axis.motion.target());
        }
        done
    }
}

/// Axes that are being jogged.
struct Jog<'a, H> {
    board: &'a Board,
    axes: Vec<Jogged>,
    hand: &'a mut H,
    began: Instant,
    snapshot: Snapshot,
    /// The cycle time in seconds.
    cycle: f64,
    depth: u16,
    held_limit_s: f64,
}

impl<H: HoldToRun> Jog<'_, H> {
    /// Moves the axes until the hand or a signal ends jogging, then brakes them.
    fn go(&mut self, mut frames: Frames<'_>) -> Result<(), BoardError> {
        let ended = self.run(&mut frames);
        let braked = self.brake(&mut frames);
        // `finish` brakes axes that are still moving, also after an error.
        let finished = frames.finish();
        ended?;
        self.board.check_stop()?;
        braked?;
        finished.map(drop)
    }

    /// Runs one cycle after the other. In each cycle, the reasons to stop axes are checked before the hand may move
    /// them. Showing comes last and never blocks.
    fn run(&mut self, frames: &mut Frames<'_>) -> Result<(), BoardError> {
        let lost_before = self.snapshot.state().is_failed();
        let mut pace = self.board.reporter.pace();
        let mut targets = Vec::new();
        loop {
            // This check comes first: otherwise braking would begin at the commanded speed and start axes that have
            // stopped.
            if frames.axes_stand() {
                self.stalled();
            }
            if self.board.interrupt.signal().is_some() {
                return Ok(());
            }
            match self.hand.held()? {
                Held::End => return Ok(()),
                Held::Nothing => self.obey(None)?,
                Held::Runs(motion) => self.obey(Some(motion))?,
            }
            self.snapshot = frames.stream.snapshot().map_err(|error| self.board.explain(error))?;
            if self.snapshot.state().is_failed() && !lost_before {
                return Err(lost(self.board, self.snapshot.state()));
            }
            self.refuse_held_axis()?;
            targets.clear();
            self.advance(&mut targets);
            if let Some(error) = frames.send(targets.iter().copied())? {
                return Err(error);
            }
            if pace.due(self.began.elapsed()) {
                self.show()?;
            }
        }
    }

    /// Handles a long delay of this process. The board has executed all buffered frames, and the axes have stopped at
    /// their last targets. They start again from rest.
    fn stalled(&mut self) {
        self.hand.stalled();
        self.axes.iter_mut().for_each(|axis| axis.motion.stand());
    }

    /// Moves the axis that is held, and brakes all other axes.
    fn obey(&mut self, held: Option<JogMotion>) -> Result<(), BoardError> {
        for (index, axis) in self.axes.iter_mut().enumerate() {
            let motion = held.filter(|motion| motion.axis == index);
            let done = match motion.map(|motion| motion.is_positive == axis.counts_up) {
                Some(to_greater_counts) if axis.motion.is_free_for(to_greater_counts) => {
                    axis.motion.run(to_greater_counts)
                }
                _ => axis.motion.brake(),
            };
            done.map_err(|why| refused(why, "choose a speed and an acceleration nearer to each other"))?;
        }
        Ok(())
    }

    /// Ends jogging if an internal limit of a drive keeps its axis away from the target for too long.
    fn refuse_held_axis(&mut self) -> Result<(), BoardError> {
        let seconds = self.began.elapsed().as_secs_f64();
        for axis in &mut self.axes {
            let target = axis.motion.target();
            if axis.held.held_for(self.board, &self.snapshot, target, seconds) >= self.held_limit_s {
                let at = self.snapshot.position(axis.slave).unwrap_or_default();
                let (label, at) = (self.board.label(axis.slave), self.board.in_units(axis.slave, at).0);
                let why = format!("axis {label} stands at {at}: {}", internal_limit::WHY);
                return Err(refused(why, internal_limit::NEXT));
            }
        }
        Ok(())
    }

    /// Adds the next target of each axis to `targets`.
    fn advance(&mut self, targets: &mut Vec<(u8, i32)>) {
        for axis in &mut self.axes {
            axis.motion.advance(self.cycle);
            let target = axis.motion.target();
            axis.sent.push_back(target);
            if axis.sent.len() > usize::from(self.depth) {
                axis.sent.pop_front();
            }
            targets.push((axis.slave, target));
        }
    }

    /// Brakes all axes, and sends their last targets until the drives have reached them.
    fn brake(&mut self, frames: &mut Frames<'_>) -> Result<(), BoardError> {
        for axis in &mut self.axes {
            axis.motion.brake().map_err(|why| refused(why, "the axis holds its last target"))?;
        }
        frames.brake(|targets| {
            self.advance(targets);
            self.axes.iter().all(|axis| axis.motion.doing() == Doing::Stands)
        })
    }
}

fn refused(why: String, next: &str) -> BoardError {
    BoardError::Refused { what: WHAT.into(), why, next: next.into() }
}
