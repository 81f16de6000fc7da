//! `ecmsk jog`: moves axes by hand, as long as a key of the terminal is held.
//!
//! Files: `dead_man.rs` says which key counts as held, `line.rs` how late keys come, `axis.rs` is the motion of an axis,
//! `terminal.rs` reads the keys, `keys.rs` knows their bytes, and `screen.rs` shows the axes.

mod axis;
mod dead_man;
#[cfg(unix)]
mod keys;
mod line;
mod screen;
mod terminal;

use std::collections::VecDeque;
use std::io::{self, IsTerminal};
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::cia402::Mode;
use ecmsk::ecm::{Snapshot, SoftLimits};
use ratatui::crossterm::event::KeyCode;

use super::OnBoard;
use super::frames::{Frames, check_lead, depth, held_limit_s, lost};
use super::motion::internal_limit::{self, Watched};
use super::motion::{AskedSpeeds, Jerk, Speeds};
use crate::board::{
    AxisWord, Board, BoardError, BoardUse, Interrupt, Needs, StepSource, duration, find_axis, in_mode, positive,
};
use crate::signals;
use axis::{Doing, JogAxis, tap, within_guard};
use dead_man::{DeadMan, MotionKey, Times};
use line::ASK_INTERVAL;
use terminal::{HAS_ANSWERS, Terminal, Token};

const WHAT: &str = "jog";
/// \[OURS] How long the repeat of a key may be missing, see [`Times`].
const FIRST_REPEAT: &str = "400ms";
const REPEAT: &str = "150ms";
/// The range of those times.
const REPEAT_RANGE: std::ops::RangeInclusive<Duration> = Duration::from_millis(30)..=Duration::from_secs(2);
/// \[OURS] A machine file's highest speed is for programs: by hand an axis has a tenth of it.
const PART_OF_MAX: f64 = 0.1;
/// \[OURS] How often it is checked whether the terminal was closed.
const CLOSED_CHECK_INTERVAL: Duration = Duration::from_millis(20);
/// \[OURS] How long the first answer of a terminal may take.
const ANSWER_LIMIT: Duration = Duration::from_secs(1);
/// The keys of the axes, in the order in which the axes are named: back and forth, and their names. One axis has them all.
const KEYS: [(KeyCode, KeyCode, &str); 3] = [
    (KeyCode::Left, KeyCode::Right, "left and right"),
    (KeyCode::Down, KeyCode::Up, "down and up"),
    (KeyCode::Char('-'), KeyCode::Char('+'), "- and +"),
];

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

/// Opens the board, moves axes by hand until a key or a signal ends it, and closes the board.
///
/// # Errors
/// [`BoardError`] if there is no terminal, the board cannot be opened, an axis is not enabled or fails, or a signal ends it.
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

/// An axis with what is known of it for its line on the screen.
struct Jogged {
    slave: u8,
    motion: JogAxis,
    /// Whether its counts grow with the positions in the unit in which it was named.
    counts_up: bool,
    /// Where it stood when the verb began, in counts.
    start: i32,
    /// The limits of the machine file.
    limits: SoftLimits,
    held: Watched,
    /// The newest targets, of which the oldest is the one that the board executes.
    sent: VecDeque<i32>,
}

impl Args {
    fn run(&self, board: &Board) -> Result<(), BoardError> {
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
        board.check_adopted(WHAT, &slaves)?;
        let config = board.known_network(WHAT)?;
        let depth = depth(config);
        // Commands that are still in the FIFO may move the axes, so their execution is awaited.
        board.run_interruptible("waiting for a standstill", |ecm| ecm.stream(depth)?.finish())?;
        let snapshot = board.ecm.snapshot()?;
        let cycle = f64::from(config.cycle_us) * 1e-6;
        // A motion that is not possible is refused when its key is pressed.
        let taps = slaves.iter().zip(&asked).filter_map(|(slave, (speeds, _))| {
            let way = tap(*speeds, self.first_repeat.as_secs_f64(), cycle).ok()?;
            Some(format!(
                "axis {} by about {}",
                board.label(*slave),
                board.distance_in_units(*slave, way.unsigned_abs())
            ))
        });
        let taps = taps.collect::<Vec<_>>().join(", ");
        let axes = slaves.iter().zip(asked).map(|(slave, (speeds, counts_up))| {
            let limits = units.axis(*slave).map_or(SoftLimits::NONE, |axis| axis.limits);
            let start = board.standing_position(&snapshot, *slave);
            let motion = JogAxis::new(start, speeds, within_guard(limits, start, board.guard));
            let (held, sent) = (Watched::new(*slave), VecDeque::new());
            Jogged { slave: *slave, motion, counts_up, start, limits, held, sent }
        });
        let axes: Vec<Jogged> = axes.collect();
        let shorter = "--velocity and --first-repeat make that shorter";
        board.reporter.note(format_args!("one tap of a key moves {taps}; {shorter}"));
        self.say_keys(board, &axes);
        let terminal = Terminal::open().map_err(BoardError::system("read the keys of the terminal"))?;
        let is_measured = HAS_ANSWERS && !self.any_line;
        if is_measured {
            require_answer(board, &terminal)?;
        }
        let frames = Frames::begin(board, snapshot.clone(), depth, cycle)?;
        let times = Times { first: self.first_repeat, repeat: self.repeat };
        let mut jog = Jog {
            board,
            axes,
            keys: DeadMan::new(times, is_measured),
            began: Instant::now(),
            snapshot,
            cycle,
            depth,
            held_limit_s: held_limit_s(depth, cycle),
        };
        let done = jog.go(frames, &terminal);
        board.reporter.clear();
        drop(terminal);
        for axis in &jog.axes {
            board.note_target(axis.slave, axis.motion.target());
        }
        done
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
                let of = |(axis, (_, _, keys)): (&Jogged, (KeyCode, KeyCode, &str))| {
                    format!("{keys} move {}", label(axis.slave))
                };
                axes.iter().zip(KEYS).map(of).collect()
            }
        };
        board.reporter.note(format_args!("{}; any other key stops, q ends", keys.join(", ")));
    }
}

/// Axes under a hand.
struct Jog<'a> {
    board: &'a Board,
    axes: Vec<Jogged>,
    keys: DeadMan,
    began: Instant,
    snapshot: Snapshot,
    /// The cycle time in seconds.
    cycle: f64,
    depth: u16,
    held_limit_s: f64,
}

impl Jog<'_> {
    /// Moves the axes until a key or a signal ends it, then brakes them.
    fn go(&mut self, mut frames: Frames<'_>, terminal: &Terminal) -> Result<(), BoardError> {
        let ended = self.follow(&mut frames, terminal);
        let braked = self.brake(&mut frames);
        // `finish` brakes axes that are still moving, also after an error.
        let finished = frames.finish();
        ended?;
        self.board.check_stop()?;
        braked?;
        finished.map(drop)
    }

    /// One cycle after the other: what stops an axis comes before what moves it, and drawing comes last and waits for nobody.
    fn follow(&mut self, frames: &mut Frames<'_>, terminal: &Terminal) -> Result<(), BoardError> {
        let lost_before = self.snapshot.state().is_failed();
        let mut pace = self.board.reporter.pace();
        let (mut next_closed_check, mut next_question) = (Instant::now(), Instant::now());
        let mut targets = Vec::new();
        loop {
            let now = Instant::now();
            // This comes first: a brake begins at the speed of the keys, and would start axes that stand.
            if frames.axes_stand() {
                self.stalled(now);
            }
            if self.board.interrupt.signal().is_some() {
                return Ok(());
            }
            if now >= next_closed_check {
                next_closed_check = now + CLOSED_CHECK_INTERVAL;
                if signals::has_hung_up(&io::stdin()) {
                    return Err(closed());
                }
            }
            if now >= next_question {
                next_question = now + ASK_INTERVAL;
                if self.keys.ask(self.at(now)) {
                    terminal.ask();
                }
            }
            if self.take_keys(terminal)? {
                return Ok(());
            }
            self.obey()?;
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
            let elapsed = self.began.elapsed();
            if pace.due(elapsed) {
                self.show()?;
            }
        }
    }

    fn at(&self, at: Instant) -> Duration {
        at.saturating_duration_since(self.began)
    }

    /// This process was late for long: the board has executed what it had, and the axes stand at their last targets. They
    /// begin from rest, and not by keys that were typed before.
    fn stalled(&mut self, now: Instant) {
        self.keys.stalled(self.at(now));
        self.axes.iter_mut().for_each(|axis| axis.motion.stand());
    }

    /// Takes the keys that have arrived; returns whether one of them ends the verb.
    fn take_keys(&mut self, terminal: &Terminal) -> Result<bool, BoardError> {
        while let Some((at, token)) = terminal.next().map_err(|_| closed())? {
            let at = self.at(at);
            let (code, is_release) = match token {
                Token::Key { code, is_release } => (code, is_release),
                Token::Interrupt => (KeyCode::Null, false),
                Token::Answer => {
                    self.keys.answer();
                    continue;
                }
            };
            match self.motion_key(code) {
                Some(motion) if !is_release => self.keys.press(at, motion),
                // The release of a key that does not move an axis is no key.
                None if is_release => {}
                None if matches!(code, KeyCode::Char('q' | 'Q') | KeyCode::Esc) => return Ok(true),
                _ => self.keys.stop(at),
            }
        }
        Ok(false)
    }

    /// The motion of a key; `None` if it moves no axis.
    fn motion_key(&self, code: KeyCode) -> Option<MotionKey> {
        // Without Shift, the key of + is = on many keyboards.
        let code = if code == KeyCode::Char('=') { KeyCode::Char('+') } else { code };
        let found = KEYS.iter().enumerate().find_map(|(axis, (back, forth, _))| {
            (code == *back || code == *forth).then_some(MotionKey { axis, is_positive: code == *forth })
        })?;
        match self.axes.len() {
            1 => Some(MotionKey { axis: 0, ..found }),
            count => (found.axis < count).then_some(found),
        }
    }

    /// The axis of the held key runs, the others brake.
    fn obey(&mut self) -> Result<(), BoardError> {
        let held = self.keys.held(self.at(Instant::now()));
        for (index, axis) in self.axes.iter_mut().enumerate() {
            let key = held.filter(|key| key.axis == index);
            let done = match key.map(|key| key.is_positive == axis.counts_up) {
                Some(to_greater_counts) if axis.motion.is_free_for(to_greater_counts) => {
                    axis.motion.run(to_greater_counts)
                }
                _ => axis.motion.brake(),
            };
            done.map_err(|why| refused(why, "choose a speed and an acceleration nearer to each other"))?;
        }
        Ok(())
    }

    /// Ends the motion if the drive of an axis holds it back.
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

    /// Adds the next target of each axis.
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

/// Waits for an answer of the terminal, so that no key counts over a line of which nothing is known.
///
/// # Errors
/// The terminal does not answer, or was closed; a signal has arrived.
fn require_answer(board: &Board, terminal: &Terminal) -> Result<(), BoardError> {
    let began = Instant::now();
    terminal.ask();
    while began.elapsed() < ANSWER_LIMIT {
        board.check_stop()?;
        match terminal.next().map_err(|_| closed())? {
            Some((_, Token::Answer)) => return Ok(()),
            Some(_) => {}
            None => thread::sleep(Duration::from_millis(1)),
        }
    }
    let why = "the terminal does not answer (to ESC [5n), so that nobody knows how late its keys come".to_owned();
    Err(refused(why, "run it in another terminal, or add --any-line if no network is between it and you"))
}

fn closed() -> BoardError {
    BoardError::Stopped { signal: signals::HANG_UP as u8, next: "the terminal was closed".into() }
}

fn refused(why: String, next: &str) -> BoardError {
    BoardError::Refused { what: WHAT.into(), why, next: next.into() }
}
