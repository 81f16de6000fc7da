//! `ecmsk replay`: sends the commands of a capture to the model, and compares its answers with the board's.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueHint;
use ecmsk::compare::{CompareOptions, Comparison, RecordedRun, Steps, TimedFrame, compare_steps};
use ecmsk::link::uri::LinkUri;
use ecmsk::recording::{Address, Skipped};
use ecmsk::replay::{FilesInLink, Replay, ReplayError};
use serde_json::{Value, json};

use super::compare::{self, CompareVerbError, How, Names};
use super::stderr::say;
use super::{plot, recording};

/// Replay the host's frames of a capture on the model: does the model answer as the board did?
///
/// Every command frame of the capture goes to the model at its original time. If the model takes longer, the frame
/// waits until the model has shown what the board had shown before it (--pace). The answers of the model are compared
/// with those of the board, command by command as in `ecmsk compare`: A is the capture, B the model. A recording made
/// by a link can be replayed, too. The capture has to begin with a board that was just switched on (Init or PreOP).
#[derive(clap::Args)]
#[command(after_help = "\
Exit codes, as those of diff: 0 the model answers as the board did, 1 otherwise, 2 it could not be replayed, or
answers so only as far as a capture goes that is not whole.

Examples:
  ecmsk replay board.pcapng --link 'sim:?slaves=drive*2,io'
  ecmsk replay board.pcapng --link 'xf-sim:?slaves=drive*2,io'
  ecmsk replay board.pcapng --link 'sim:?slaves=drive*2' --tolerance 20 --statusword-mask 0x006F --plot difference.svg
  ecmsk replay windows.pcapng --device 2.7 --link 'sim:?slaves=io' --json")]
pub struct Args {
    /// The capture of usbmon or USBPcap (pcapng, pcap), or a recording
    #[arg(value_name = "CAPTURE", value_hint = ValueHint::FilePath)]
    capture: PathBuf,

    /// The model, with the slaves that the board had, see `ecmsk link help`; it has the slot size of the capture
    /// [default: the recorded link, if it is one of a model]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    /// When the model gets a command: at its time in the capture, or when it has also shown what the board had shown
    /// before, such as states, SDO answers and axes at standstill [default: answers, if only one of board and model is
    /// behind an ECM-XF, else times]
    #[arg(long, value_name = "times|answers", value_enum)]
    pace: Option<Pace>,

    /// In a capture, use only this device, by its bus and address, e.g. 1.5
    #[arg(long, value_name = "BUS.ADDRESS", value_parser = recording::parse_device)]
    device: Option<Address>,

    /// Open the files that the link in the recording names, such as script=; only for recordings that you made yourself
    #[arg(long, conflicts_with = "link")]
    allow_files: bool,

    #[command(flatten)]
    how: How,
}

/// When the model gets a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Pace {
    /// At its time in the capture
    Times,
    /// When the model has shown what the board had shown before it
    Answers,
}

/// Why a capture was not replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayVerbError {
    /// The recording cannot be read, or it cannot be replayed on the model.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// The two runs cannot be compared, or the result cannot be printed.
    #[error(transparent)]
    Compare(#[from] CompareVerbError),
    /// The plot of the two runs cannot be drawn or written.
    #[error(transparent)]
    Plot(#[from] plot::PlotError),
    /// Standard input is named, but a capture is read more than once.
    #[error("standard input cannot be replayed, it can be read only once; save it to a file and name that")]
    Stdin,
}

/// Replays the capture. Returns the exit code of a comparison: it tells whether the runs differ.
pub fn run(args: &Args) -> Result<ExitCode, ReplayVerbError> {
    if args.capture == Path::new("-") {
        return Err(ReplayVerbError::Stdin);
    }
    let options = args.how.options();
    let files = if args.allow_files { FilesInLink::Allowed } else { FilesInLink::Refused };
    let replay = Replay::open(&args.capture, args.link.as_ref(), &options, args.device, files)?;
    let pace = args.pace.unwrap_or(if replay.is_alike() { Pace::Times } else { Pace::Answers });
    let (board, found, waited_ns) = play(&replay, pace, &options)?;
    let lacks = compare::tell("A", &board).map_err(CompareVerbError::from)?;
    let before = replay.start().skipped;
    if before > 0 {
        let left = "what the board was told before it is not known; begin a capture with the board just switched on";
        say("note", &format_args!("A: {before} frames before the network was in PreOP are left out: {left}"));
    }
    if waited_ns > 0 {
        let left = "it gets a command when it has shown what the board had shown before; --pace times does not wait";
        say("note", &format_args!("B: the model took {:.3} s longer: {left}", waited_ns as f64 / 1e9));
    }
    let capture = args.capture.display();
    let capture = match board.meta() {
        Some(_) => capture.to_string(),
        None => format!("{capture} (device {})", replay.board()),
    };
    let names = Names { runs: [capture, replay.link().to_string()], lacks: [lacks, None], plot: args.how.plot.clone() };
    if let Some(file) = &args.how.plot {
        let steps = |run| Steps::new(run, replay.size(), options.ignore_repeats);
        let (board, model): (Run, Run) = match pace {
            Pace::Times => replay.runs().map(|(board, model)| (boxed(board), boxed(model)))?,
            Pace::Answers => replay.waiting_runs().map(|(board, model)| (boxed(board), boxed(model)))?,
        };
        let drawing = compare::draw(steps(board), steps(model), &names, &found)?;
        args.how.picture(file, &[&args.capture])?.save(&drawing)?;
    }
    let text = if args.how.json {
        let mut object = compare::json::object(&names, &found, &options);
        object["left_out"] = left_out(before, &board.skipped());
        object["waited_ns"] = waited_ns.into();
        object.to_string() + "\n"
    } else {
        compare::text(&names, &found)
    };
    Ok(compare::print(text, names.code(&found, &options))?)
}

/// The frames of the recorded board or of the model. Each [`Pace`] has iterators of its own types, so they are boxed.
type Run = Box<dyn Iterator<Item = TimedFrame>>;

fn boxed(run: impl Iterator<Item = TimedFrame> + 'static) -> Run {
    Box::new(run)
}

/// Compares the recorded run with that of the model. Returns the recorded run after reading it to its end, the result, and how
/// long the model's host has waited for answers, in nanoseconds.
fn play(replay: &Replay, pace: Pace, options: &CompareOptions) -> Result<(RecordedRun, Comparison, i64), ReplayError> {
    let size = replay.size();
    match pace {
        Pace::Times => {
            let (mut board, model) = replay.runs()?;
            let steps = Steps::new(model, size, options.ignore_repeats);
            let found = compare_steps(Steps::new(&mut board, size, options.ignore_repeats), steps, options);
            Ok((board, found, 0))
        }
        Pace::Answers => {
            let (mut board, mut model) = replay.waiting_runs()?;
            let steps = Steps::new(&mut model, size, options.ignore_repeats);
            let found = compare_steps(Steps::new(&mut board, size, options.ignore_repeats), steps, options);
            Ok((board, found, model.waited_ns()))
        }
    }
}

/// The counts of recorded traffic that was not sent to the model, as JSON.
fn left_out(before_start: u64, skipped: &Skipped) -> Value {
    let Skipped { taken_back, without_report, other_lengths, other_transfers, other_devices } = *skipped;
    json!({
        "frames_before_start": before_start,
        "frames_taken_back": taken_back,
        "reads_without_report": without_report,
        "transfers_of_other_length": other_lengths,
        "other_packets": other_transfers,
        "packets_of_other_devices": other_devices,
    })
}
