//! `ecmsk run`: runs a script, which is a text file with one step per line, on one open board.

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::ValueHint;
use ecmsk::ecm::Config;

use super::board::{self, Board, BoardError, BoardUse, Interrupt, StepSource, Units};
use super::junit::{self, Case};
use super::output_file::Replace;
use super::stderr::say;
use super::step::{Line, Step};

/// Run a script: several steps on one open board
///
/// A line is a verb with its options, as on the command line: state, servo, home, move, io, sdo, info; wait TIME; expect,
/// which fails if the board is not as expected; fault, which makes an event happen on a simulated board. `#` starts a comment. The whole script is read and checked before anything
/// is sent; the first step that fails ends it.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  state op
  servo on 1,2
  home 1,2                              # as the drives are set
  move 1=10000 2=-5000 --velocity 20000
  wait 0.5s
  io 3 --set 0x1
  expect position 1=10000 2=-5000 --within 2")]
pub struct Args {
    /// The script; `-` is standard input
    #[arg(value_name = "SCRIPT", value_hint = ValueHint::FilePath)]
    script: PathBuf,

    /// Write the result of each step to this file, in the JUnit format; times are the board's
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    junit: Option<PathBuf>,

    #[command(flatten)]
    board: board::Args,
}

impl Args {
    /// The name of the script in messages.
    fn name(&self) -> String {
        if self.script == Path::new("-") { STDIN.into() } else { self.script.display().to_string() }
    }
}

/// The name of standard input in messages.
pub const STDIN: &str = "standard input";
/// \[OURS] The largest script, in bytes.
const SCRIPT_BYTES_MAX: u64 = 1 << 20;

/// Runs `ecmsk run`: reads the script, checks all of it, and executes its steps on the board.
///
/// # Errors
/// [`BoardError`] if the script cannot be read or has an invalid line, the board cannot be opened, a step fails, or a
/// signal stops the script.
pub fn run(args: &Args) -> Result<(), BoardError> {
    let text = read(&args.script, &args.name())?;
    play(&text, args, Interrupt::watch)
}

/// Runs the script `text`. `watch` starts watching for signals; fuzz targets pass one that does nothing.
///
/// # Errors
/// [`BoardError`] if the script has an invalid line, the board cannot be opened, a step fails, or a signal stops the
/// script.
pub fn play(text: &str, args: &Args, watch: fn() -> Result<Interrupt, BoardError>) -> Result<(), BoardError> {
    // The output file is checked before anything moves.
    let junit = args.junit.as_deref().map(|file| junit::output(file, Replace::Never));
    junit.map_or(Ok(()), |junit| junit.check())?;
    let mut cases = Vec::new();
    let done = play_steps(text, args, watch, &mut cases);
    let Some(junit) = junit else { return done };
    if let Err(error) = &done
        && cases.iter().all(|case| case.failure.is_none())
    {
        // No step has failed: the script or the board could not be used, or a signal came.
        cases.push(Case { name: "the whole run".to_owned(), failure: Some(error.to_string()), time: Duration::ZERO });
    }
    junit::write(&junit, &format!("ecmsk run {}", args.name()), &cases)?;
    done
}

fn play_steps(
    text: &str,
    args: &Args,
    watch: fn() -> Result<Interrupt, BoardError>,
    cases: &mut Vec<Case>,
) -> Result<(), BoardError> {
    let name = args.name();
    let machine = args.board.machine(BoardUse::Moves)?;
    let uri = args.board.chosen(machine.as_ref())?.uri;
    let network = args.board.network(&uri, None, machine.as_ref());
    let scales = args.board.scales();
    let units = Units { option: scales, numbers: scales, machine: machine.as_ref() };
    let steps = parse(text, &name, network.as_ref(), units)?;
    let board = Board::open(&args.board, BoardUse::Moves, StepSource::Lines, watch()?)?;
    let done = steps.iter().try_for_each(|(line, step)| {
        board.reporter.at_line(*line);
        let began = opened_for(&board);
        let done = step.run(&board);
        let time = opened_for(&board).saturating_sub(began);
        let words = text.lines().nth(*line as usize - 1).unwrap_or_default();
        let words = words.split_once('#').map_or(words, |(words, _)| words).trim();
        let failure = done.as_ref().err().map(ToString::to_string);
        cases.push(Case { name: format!("line {line}: {words}"), failure, time });
        done.map_err(|error| at(&name, *line, error))
    });
    board.close(done)
}

/// How long the board has been open, in its time. Zero after it was lost.
fn opened_for(board: &Board) -> Duration {
    let opened = board.ecm.link_info().opened_at.0;
    Duration::from_nanos(board.ecm.snapshot().map_or(0, |snapshot| snapshot.meta.at.0.saturating_sub(opened)))
}

fn read(path: &Path, name: &str) -> Result<String, BoardError> {
    let mut bytes = Vec::new();
    let file: Result<Box<dyn Read>, io::Error> = if path == Path::new("-") {
        Ok(Box::new(io::stdin()))
    } else {
        fs::File::open(path).map(|file| Box::new(file) as _)
    };
    let wrong =
        |why: String, next: &str| BoardError::Refused { what: format!("the script {name}"), why, next: next.into() };
    let read = file.and_then(|file| file.take(SCRIPT_BYTES_MAX + 1).read_to_end(&mut bytes));
    read.map_err(|error| wrong(error.to_string(), "name a file that can be read"))?;
    if bytes.len() as u64 > SCRIPT_BYTES_MAX {
        return Err(wrong(format!("it is longer than {SCRIPT_BYTES_MAX} bytes"), "cut it into several"));
    }
    String::from_utf8(bytes).map_err(|_| wrong("it is not UTF-8".into(), "name a text file"))
}

/// Parses all steps, with the numbers of their lines. Prints an error for every invalid line.
fn parse(text: &str, name: &str, network: Option<&Config>, units: Units<'_>) -> Result<Vec<(u32, Step)>, BoardError> {
    let mut steps = Vec::new();
    let mut wrong = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let checked = Line::parse(line).and_then(|line| match line {
            Line::Empty => Ok(None),
            Line::Step(step) => step.check(network, units).map(|()| Some(*step)).map_err(|error| error.to_string()),
        });
        match checked {
            Ok(step) => steps.extend(step.map(|step| (number, step))),
            Err(why) => wrong.push(format!("{name}:{number}: {why}")),
        }
    }
    let Some((last, others)) = wrong.split_last() else { return Ok(steps) };
    others.iter().for_each(|why| say("error", why));
    Err(BoardError::Script { last: last.clone() })
}

/// Adds the script's name and the line to an error. A signal and an error of standard output have nothing to do with the
/// line, so they stay as they are.
pub fn at(name: &str, line: u32, error: BoardError) -> BoardError {
    match error {
        error @ (BoardError::Stopped { .. } | BoardError::Output(_)) => error,
        error => BoardError::Line { place: format!("{name}:{line}"), why: error.to_string() },
    }
}
