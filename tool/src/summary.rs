//! `ecmsk summary`: lists the problems of a recorded run, and the extremes of its axes.
//!
//! Files:
//!
//! - `summary.rs`: the verb
//! - `summary/extremes.rs`: the extremes of each axis
//! - `summary/fail_on.rs`: the option that decides which findings make a run fail

pub mod extremes;
pub mod fail_on;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueHint;
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::InOrder;
use ecmsk::recording::{Address, RecordError};
use ecmsk::sk::SlotSize;
use ecmsk::summary::{FrameWatch, Summary};
use serde_json::{Value, json as object};

use extremes::Extremes;
use fail_on::FailOn;

use super::error::CliError;
use super::machine_option::{alarm_words, label};
use super::recording::{Framed, Frames, board, parse_device};
use super::stderr::say;
use super::{machine_option, output, slot_size};

/// Show what went wrong in a recorded run: alarms, failed changes of state, gaps, a full FIFO, wrong CRCs; and the extremes of
/// each axis
///
/// Prints the summary of `ecmsk exec`, as far as frames show it. Frames do not show which commands the board has
/// rejected: a simulated board counts those, and `ecmsk exec` prints them. A line for each axis that was moved follows: the
/// largest following error (the target in force minus the position), step of the target from one cycle to the next, velocity
/// and torque, each with its time since the first frame.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk summary run.pcapng
  ecmsk summary --json run.pcapng | jq .alarms
  ecmsk summary --fail-on alarm,gap,following-error>500,torque>90 run.pcapng

Exit code: 0, whatever went wrong, unless --exit-code or --fail-on is given; 1 if the recording cannot be read.")]
pub struct Args {
    /// The recording or capture; - for standard input
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// Bytes of a slot, 12 or 16 [default: from the recording, else from its CRCs]
    #[arg(long, visible_alias = "slot", value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// In a capture with several boards, use the one at BUS.DEVICE
    #[arg(long, value_name = "BUS.DEVICE", value_parser = parse_device)]
    device: Option<Address>,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    /// Print one JSON object
    #[arg(long)]
    json: bool,

    /// End with exit code 1 if the summary reports anything that went wrong, or if the recording is incomplete
    #[arg(long)]
    exit_code: bool,

    /// End with exit code 1 if one of these happened, and print which: any (as --exit-code), alarm, state, gap, or an axis
    /// went beyond a limit: following-error>COUNTS, target-step>COUNTS, velocity>COUNTS_PER_S, torque>PERCENT. With a
    /// machine file, limits may be in units, as in following-error>0.5mm
    #[arg(long, value_name = "REASON,..", value_delimiter = ',', value_parser = FailOn::parse)]
    fail_on: Vec<FailOn>,
}

/// Runs `ecmsk summary`: reads the recording to its end and prints what went wrong in it. The exit code is 1 if
/// `--exit-code` or `--fail-on` asks for it.
///
/// # Errors
/// [`CliError`] if the recording or the machine file cannot be read, or standard output cannot be written to.
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let machine = machine_option::load(args.machine.as_deref())?;
    let is_file = args.file.as_os_str() != "-";
    let device = if is_file { board(&args.file, args.device)? } else { args.device };
    let mut frames = Frames::open(&args.file, args.slot_size, device)?;
    let mut watch = None;
    let (mut summary, mut is_whole) = (Summary::default(), true);
    let mut order = InOrder::default();
    let mut extremes = Extremes::new();
    let mut take = |framed: Framed| {
        extremes.frame(&framed);
        let watch = watch.get_or_insert_with(|| FrameWatch::new(framed.size));
        match framed.recorded.dir {
            ecmsk::link::Dir::Write => watch.command(framed.time_ns, &framed.recorded.frame),
            ecmsk::link::Dir::Read => {
                watch.report(framed.time_ns, &framed.recorded.frame, &mut |event| summary.add_event(event));
            }
        }
    };
    for framed in &mut frames {
        match framed {
            Ok(framed) => {
                if let Some(framed) = order.push(framed.time_ns, framed) {
                    take(framed);
                }
            }
            // A truncated or malformed recording ends the reading, but the summary of the frames before is still printed.
            Err(error @ (RecordError::Truncated { .. } | RecordError::Malformed { .. })) => {
                is_whole = false;
                say("note", &error);
            }
            Err(error) => return Err(error.into()),
        }
    }
    while let Some(framed) = order.pop() {
        take(framed);
    }
    is_whole &= frames.lacks().is_none();
    let counts = watch.map(|watch| watch.counts()).unwrap_or_default();
    summary.set_frame_counts(&counts);
    frames.note_missing();
    let axes: Vec<_> = extremes.axes().collect();
    if args.json {
        let mut json = json(&summary, machine.as_ref());
        let axis = |(slave, axis): &(usize, &_)| extremes::axis_json(*slave, axis, machine.as_ref());
        json["axes"] = axes.iter().map(axis).collect();
        output::print(format!("{json}\n"))?;
    } else {
        let line = |(slave, axis): &(usize, &_)| extremes::line(*slave, axis, machine.as_ref()) + "\n";
        let lines: String = axes.iter().map(line).collect();
        output::print(format!("{summary}{}{lines}", alarm_texts(&summary, machine.as_ref())))?;
    }
    let failures = args.fail_on.iter().flat_map(|reason| reason.failures(&summary, is_whole, &axes, machine.as_ref()));
    let failed = failures.inspect(|failure| say("failed", failure)).count() > 0;
    let is_clean = summary.is_empty() && is_whole;
    Ok(if failed || args.exit_code && !is_clean { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// For each alarm in the summary that has a text in the machine file, a line with that text.
fn alarm_texts(summary: &Summary, machine: Option<&MachineFile>) -> String {
    let alarms = summary.alarms().filter_map(|(alarm, _)| {
        let text = machine?.alarm_text(alarm.slave, alarm.code)?;
        Some(format!("axis {}: alarm 0x{:04X} is: {text}\n", label(machine, alarm.slave), alarm.code))
    });
    alarms.collect()
}

/// The summary as a JSON object: counts, alarms with their meanings, failed states, and messages of the board.
pub fn json(summary: &Summary, machine: Option<&MachineFile>) -> Value {
    let alarms: Vec<_> = summary
        .alarms()
        .map(|(alarm, times)| {
            let meaning = alarm_words(machine, alarm.slave, alarm.code);
            object!({"slave": alarm.slave, "error_code": alarm.code, "meaning": meaning, "times": times})
        })
        .collect();
    let states: Vec<_> = summary
        .states_failed()
        .map(|(failed, times)| object!({"state": failed.state, "text": failed.to_string(), "times": times}))
        .collect();
    let messages: Vec<_> = summary.messages().map(|(text, times)| object!({"text": text, "times": times})).collect();
    let counts: serde_json::Map<String, Value> =
        summary.counts().map(|(name, value)| (name.to_owned(), value.into())).collect();
    object!({"counts": counts, "alarms": alarms, "states_failed": states, "said": messages})
}
