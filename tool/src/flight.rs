//! `ecmsk flight`: what a flight recorder has kept, and marks for it.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::{Subcommand, ValueHint};
use ecmsk::link::record::flight::{self, FlightContents, FlightSegment, KeptMoment, Kind, Moment};
use ecmsk::machine_file::MachineFile;
use serde_json::{Value, json};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use super::{CliError, machine_option, output, recording};

/// How long `ecmsk flight mark` waits until its mark is taken: recorders look for marks once a second. \[OURS]
const TAKEN_MAX: Duration = Duration::from_secs(3);
/// The interval at which `ecmsk flight mark` checks whether its mark was taken.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// Show what a flight recorder has kept, and mark moments for it
///
/// A flight recorder keeps the frames of the last hours in a folder, in segments, of which the oldest is deleted. What
/// surrounds an alarm, an axis that is held back, a lost slave, a failed change of state, a gap of reports, a following
/// error beyond flight_following_error= or a mark is kept for longer: from 30 s before to 10 s after. `ecmsk exec --flight
/// DIR`, `ecmsk serve tcp --flight DIR` and the key flight=DIR of any link to a board record. Segments and moments are
/// recordings for `ecmsk plot`, `ecmsk dump`, `ecmsk summary`.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk exec --link usb: --flight flight -- ./program
  ecmsk flight mark flight 'a noise at the left axis'
  ecmsk flight list flight
  ecmsk plot flight/kept/moment-00000001.ecmrec"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    List(List),
    Mark(Mark),
}

/// Show the segments and the kept moments in the folder of a flight recorder, with times (UTC), reasons and sizes
#[derive(clap::Args)]
struct List {
    /// The folder
    #[arg(value_name = "DIR", value_hint = ValueHint::DirPath)]
    folder: PathBuf,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Keep what surrounds the present moment, with a text
///
/// The process that records to the folder does not wait for this one: it finds the mark within a second, at its next frame.
#[derive(clap::Args)]
struct Mark {
    /// The folder that is being recorded to
    #[arg(value_name = "DIR", value_hint = ValueHint::DirPath)]
    folder: PathBuf,

    /// What is to be remembered, in one line
    #[arg(value_name = "TEXT")]
    text: String,
}

/// Why a verb of `ecmsk flight` failed.
#[derive(Debug, thiserror::Error)]
pub enum FlightVerbError {
    /// The folder cannot be read, or no mark can be put into it.
    #[error("{}: {source}; {}", .folder.display(), next_step(.source))]
    Folder {
        /// The path of the folder.
        folder: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
}

fn next_step(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::NotFound => "name the DIR of `--flight DIR` or of `flight=DIR` in a link",
        io::ErrorKind::NotConnected => "start a program with `ecmsk exec --flight DIR`, or with flight=DIR in its link",
        _ => "look at the path and who may use it",
    }
}

/// Runs `ecmsk flight`.
///
/// # Errors
/// [`CliError`] if the folder cannot be read or marked, or standard output cannot be written to.
pub fn run(args: &Args) -> Result<(), CliError> {
    match &args.verb {
        Verb::List(args) => list(args),
        Verb::Mark(args) => mark(args),
    }
}

fn mark(args: &Mark) -> Result<(), CliError> {
    let failed = |source| FlightVerbError::Folder { folder: args.folder.clone(), source };
    let file = flight::mark(&args.folder, &args.text).map_err(failed)?;
    let began = Instant::now();
    while file.exists() && began.elapsed() < TAKEN_MAX {
        std::thread::sleep(LOOK_INTERVAL);
    }
    let when = if file.exists() { "will be marked at the next frame" } else { "marked" };
    Ok(output::print(format!("{when}\n"))?)
}

fn list(args: &List) -> Result<(), CliError> {
    let failed = |source| FlightVerbError::Folder { folder: args.folder.clone(), source };
    let contents = FlightContents::of(&args.folder).map_err(failed)?;
    let newest = contents.moments.iter().rev().find_map(|kept| kept.file.as_deref());
    let newest = newest.or_else(|| contents.segments.last().map(|segment| &*segment.file));
    let carried = newest.and_then(recording::carried);
    let machine = machine_option::of_recording(args.machine.as_deref(), carried.as_deref())?;
    let contents = with_words(contents, machine.as_ref());
    let text = if args.json { format!("{}\n", as_json(&contents)) } else { as_text(&contents, &args.folder) };
    Ok(output::print(text)?)
}

/// Replaces the slave and the code of each alarm among the reasons by the name of the axis and the alarm text of the
/// machine file.
fn with_words(mut contents: FlightContents, machine: Option<&MachineFile>) -> FlightContents {
    let Some(machine) = machine else { return contents };
    for reason in contents.moments.iter_mut().flat_map(|kept| &mut kept.moment.reasons) {
        if let Some(text) = alarm_in_words(machine, &reason.text).filter(|_| reason.kind == Kind::Alarm) {
            reason.text = text;
        }
    }
    contents
}

/// The text of an alarm, `slave 1 has an alarm, 0x7500: ..`, in the words of the machine file; `None` if it has another form.
fn alarm_in_words(machine: &MachineFile, text: &str) -> Option<String> {
    let (slave, rest) = text.strip_prefix("slave ")?.split_once(' ')?;
    let slave = slave.parse().ok()?;
    let who = machine.axis_of(slave).map_or_else(|| format!("slave {slave}"), |axis| format!("axis {}", axis.name));
    let code = rest.strip_prefix("has an alarm, 0x").and_then(|code| u16::from_str_radix(code.get(..4)?, 16).ok());
    Some(match code.and_then(|code| Some((code, machine.alarm_text(slave, code)?))) {
        Some((code, words)) => format!("{who} has an alarm, 0x{code:04X}: {words}"),
        None => format!("{who} {rest}"),
    })
}

fn as_text(contents: &FlightContents, folder: &Path) -> String {
    let FlightContents { segments, moments, writer } = contents;
    let mut text = match writer {
        Some(pid) => format!("process {pid} is recording to {}\n", folder.display()),
        None => format!("nothing is being recorded to {}\n", folder.display()),
    };
    text += &format!("kept moments: {}, {}\n", moments.len(), size(moments.iter().map(|kept| kept.bytes).sum()));
    for KeptMoment { moment, file, bytes } in moments {
        let Moment { from_ns, to_ns, is_virtual, reasons, more, .. } = moment;
        let from = when(*from_ns, *is_virtual);
        text += &match file {
            Some(file) => format!("  {from}  {}  {}\n", size(*bytes), file.display()),
            None => format!("  {from}  it lasts, up to {}\n", when(*to_ns, *is_virtual)),
        };
        for reason in reasons {
            text += &format!("    {}  {}: {}\n", when(reason.at_ns, *is_virtual), reason.kind.word(), reason.text);
        }
        if *more > 0 {
            text += &format!("    and {more} more\n");
        }
    }
    text += &format!("segments: {}, {}\n", segments.len(), size(segments.iter().map(|segment| segment.bytes).sum()));
    for FlightSegment { file, bytes, times_ns, is_virtual, .. } in segments {
        let times = times_ns.map_or_else(
            || "no frame".to_owned(),
            |(first, last)| {
                let seconds = last.saturating_sub(first) as f64 / 1e9;
                format!("{}  {seconds:.1} s", when(first, *is_virtual))
            },
        );
        text += &format!("  {times}  {}  {}\n", size(*bytes), file.display());
    }
    text
}

fn as_json(contents: &FlightContents) -> Value {
    let moments = contents.moments.iter().map(|KeptMoment { moment, file, bytes }| {
        let reasons = moment.reasons.iter().map(|reason| {
            json!({"at_ns": reason.at_ns, "at": utc(reason.at_ns, moment.is_virtual), "kind": reason.kind.word(),
                "text": reason.text})
        });
        json!({"number": moment.number, "from_ns": moment.from_ns, "to_ns": moment.to_ns,
            "from": utc(moment.from_ns, moment.is_virtual), "reasons": reasons.collect::<Vec<_>>(),
            "more_reasons": moment.more, "file": file.as_ref().map(|file| file.display().to_string()), "bytes": bytes})
    });
    let segments = contents.segments.iter().map(|segment| {
        let times = segment.times_ns;
        json!({"number": segment.number, "first_ns": times.map(|times| times.0), "last_ns": times.map(|times| times.1),
            "first": times.and_then(|times| utc(times.0, segment.is_virtual)),
            "file": segment.file.display().to_string(), "bytes": segment.bytes})
    });
    json!({"writer": contents.writer, "moments": moments.collect::<Vec<_>>(), "segments": segments.collect::<Vec<_>>()})
}

/// A time of a recording as text: in UTC, or in seconds for a virtual clock.
fn when(at_ns: u64, is_virtual: bool) -> String {
    utc(at_ns, is_virtual).unwrap_or_else(|| format!("{:.3} s", at_ns as f64 / 1e9))
}

/// The wall time in UTC to a millisecond; `None` for a virtual clock.
fn utc(at_ns: u64, is_virtual: bool) -> Option<String> {
    let milliseconds = i128::from(at_ns / 1_000_000) * 1_000_000;
    let at = OffsetDateTime::from_unix_timestamp_nanos(milliseconds).ok().filter(|_| !is_virtual)?;
    at.format(&Rfc3339).ok()
}

/// A number of bytes as text.
fn size(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} bytes"),
        10_000..10_000_000 => format!("{} kB", bytes / 1000),
        _ => format!("{} MB", bytes / 1_000_000),
    }
}
