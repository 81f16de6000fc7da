//! `ecmsk find`: the times at which a condition becomes true in a recording.
//!
//! Files:
//!
//! - `find.rs`: the verb
//! - `find/expression.rs`: reads the expression; `find/words.rs`: its words; `find/measure.rs`: the units of its numbers
//! - `find/condition.rs`: whether a condition holds at a report
//! - `find/values.rs`: the values of axes and board at each report
//! - `find/spans.rs`: from when to when a condition holds; `find/search.rs`: all of this for one condition

mod condition;
mod expression;
mod measure;
#[cfg_attr(not(feature = "web"), allow(dead_code, reason = "only the page needs all of it"))]
mod search;
#[cfg_attr(not(feature = "web"), allow(dead_code, reason = "only the page needs all of it"))]
mod spans;
mod values;
mod words;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueHint;
use ecmsk::machine_file::MachineFileError;
use ecmsk::recording::{Address, RecordError};
use ecmsk::sk::SlotSize;
use serde_json::json;

use super::error::CliError;
use super::filter::TimeOptions;
use super::recording::{Frames, parse_device};
use super::stderr::say;
use super::{compare, machine_option, output, slot_size};
pub use expression::ExpressionError;
pub use search::Search;
use spans::Span;

/// Exit code if the condition never becomes true, as grep(1) has it. If nothing could be looked for it is
/// [`compare::TROUBLE`].
const NOTHING: u8 = 1;

/// Find the times at which a condition becomes true in a recording, as `following_error(X) > 0.5 and not homing`
///
/// Prints a line for each: the time since the board was opened, in a capture since its first frame, and how long the condition
/// held. The condition is looked at in each report of the board.
#[derive(clap::Args)]
#[command(after_help = "\
Numbers, of the axis A, which is the number of a slave or a name of the machine file:
  position(A)         actual position
  target(A)           target in force, from its execution on
  following_error(A)  distance between the two while the axis is enabled
  target_step(A)      distance from the last target to this one
  velocity(A)         of the position, negative when it falls
  torque(A)           actual torque in % of the rated torque
  alarm(A)            error code of the alarm, 0 without one
  fifo                free entries of the FIFO
  state               state of the network: Init, PreOP, SafeOP, OP, or byte 2 of slot 0, as 0x18

Positions of an axis by name are in the unit of the machine file, those by number in counts. A unit behind a number says it
in any case: 0.5mm, 20 mm/s, 500counts, 80%.

True or false, of the axis A, or of any axis without (A):
  enabled, fault, alarm, homing, quick_stop, warning, target_reached, internal_limit, remote, voltage_enabled
  lost                the board is in state 0x18, and the slot of the axis does not change
  gap                 (of no axis) the FIFO was empty in a motion

Joined by: < <= > >= == != + - abs() and or not ( )

Examples:
  ecmsk find 'following_error(1) > 500 and not homing' run.pcapng
  ecmsk find 'abs(position(X) - position(Y)) > 0.2mm' run.pcapng
  ecmsk find alarm run.pcapng | while read -r at _; do ecmsk plot run.pcapng --around \"$at\" -o \"$at.svg\"; done

Exit code, as that of grep: 0 it became true, 1 it never did, 2 the expression is wrong or the recording cannot be read.")]
pub struct Args {
    /// The condition
    #[arg(value_name = "EXPRESSION")]
    expression: String,

    /// The recording or capture; - for standard input
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    #[command(flatten)]
    times: TimeOptions,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    /// Print one JSON object for each time, each on a line of its own
    #[arg(long)]
    json: bool,

    /// Bytes of a slot, 12 or 16 [default: from the recording, else from its CRCs]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// In a capture with several boards, use the one at BUS.DEVICE
    #[arg(long, value_name = "BUS.DEVICE", value_parser = parse_device)]
    device: Option<Address>,
}

/// Why the recording was not searched.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    /// A folder was named in the place of a recording.
    #[error("{} is a folder; name a recording in it, or run `ecmsk summary {}` for all of them", .0.display(), .0.display())]
    Folder(PathBuf),
    /// The expression is wrong.
    #[error("{0}; see `ecmsk find --help`")]
    Expression(#[from] ExpressionError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// The machine file cannot be used.
    #[error(transparent)]
    MachineFile(#[from] MachineFileError),
}

impl FindError {
    /// The exit code of the tool for this error.
    pub const fn code(&self) -> u8 {
        compare::TROUBLE
    }
}

/// Runs `ecmsk find`: reads the recording to its end and prints when the condition became true.
///
/// # Errors
/// [`CliError::Find`] if the expression is wrong, or the recording or the machine file cannot be read; [`CliError::Output`] if
/// standard output cannot be written to.
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let (found, is_whole) = find(args)?;
    let lines: String = found.iter().map(|span| if args.json { in_json(span) } else { in_words(span) }).collect();
    output::print(lines)?;
    Ok(match (found.is_empty(), is_whole) {
        (false, _) => ExitCode::SUCCESS,
        (true, true) => ExitCode::from(NOTHING),
        // The condition may have become true in the part that cannot be read.
        (true, false) => ExitCode::from(compare::TROUBLE),
    })
}

/// The spans of time in which the condition was true, and whether all frames could be read.
fn find(args: &Args) -> Result<(Vec<Span>, bool), FindError> {
    if args.file.is_dir() {
        return Err(FindError::Folder(args.file.clone()));
    }
    let (from_stdin, carried) = machine_option::carried_by(&args.file, args.slot_size, args.device)?;
    let machine = machine_option::of_recording(args.machine.as_deref(), carried.as_deref())?;
    let mut search = Search::parse(&args.expression, machine.as_ref())?;
    let open = || Frames::open_board(&args.file, args.slot_size, args.device);
    let mut frames = from_stdin.map_or_else(open, Ok)?;
    let times = args.times.times();
    let mut is_any = false;
    let walked = frames.walk(i64::MAX, |framed| {
        let counts = times.contains(framed.time_ns);
        is_any |= counts;
        search.frame(framed, counts);
    })?;
    frames.note_zero();
    frames.note_walked(&walked);
    if !is_any {
        say("note", &"no frame is left; change --from, --to or --around");
    }
    let lacks = frames.lacks().unwrap_or_default();
    let is_whole = walked.damage.is_none() && lacks.missing == 0 && lacks.damage.count == 0;
    Ok((search.finish(), is_whole))
}

/// A span of time as a line of text: `6.020000000 s  for 0.019000000 s`. Times have the form of `ecmsk dump`.
fn in_words(span: &Span) -> String {
    let [at, lasts] = [span.from_ns, span.lasts_ns()].map(output::seconds);
    let end = if span.ended { "" } else { ", to the end" };
    format!("{at:>14} s  for {lasts} s{end}\n")
}

fn in_json(span: &Span) -> String {
    let [at, lasts] = [span.from_ns, span.lasts_ns()].map(|ns| ns as f64 / 1e9);
    format!("{}\n", json!({"at_s": at, "duration_s": lasts, "ended": span.ended}))
}
