//! `ecmsk summary`: lists the problems of a recorded run, and the extremes of its axes.
//!
//! Files:
//!
//! - `summary.rs`: the verb
//! - `summary/events.rs`: alarms, failed states, gaps and losses
//! - `summary/extremes.rs`: the extremes of each axis
//! - `summary/fail_on.rs`: the option that decides which findings make a run fail
//! - `summary/page.rs`: the page for a browser
//! - `summary/trends.rs`: trends over the recordings of a folder

mod events;
pub mod extremes;
pub mod fail_on;
mod page;
mod trends;

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::ValueHint;
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::Address;
use ecmsk::sk::SlotSize;
use ecmsk::summary::Summary;
use serde_json::{Value, json as object};

use events::Events;
use extremes::Extremes;
use fail_on::FailOn;

use super::error::CliError;
use super::filter::TimeOptions;
use super::junit::{self, Case};
use super::machine_option::{alarm_words, label};
use super::output_file::{Kind, OutputFile, OutputFileError, OverwriteOption};
use super::plot::survey::Survey;
use super::recording::{Frames, is_same_file, parse_device};
use super::stderr::say;
use super::{machine_option, output, slot_size};

/// Show what went wrong in a recorded run: alarms, failed changes of state, gaps, a full FIFO, wrong CRCs; and the extremes of
/// each axis; of a folder, the trends
///
/// Prints the summary of `ecmsk exec`, as far as frames show it. Frames do not show which commands the board has
/// rejected: a simulated board counts those, and `ecmsk exec` prints them. A line for each axis that was moved follows: the
/// largest following error (the target in force minus the position), step of the target from one cycle to the next, velocity
/// and torque, each with its time since the board was opened; in a capture since the first frame.
///
/// Of a folder with recordings, or of a flight recorder, it prints trends: tables with a line for each recording, hour or day.
/// For each axis they have the largest values, the following error of the motion that most lines have in common (from and to
/// the same targets), and where homings found home: the new zero in the coordinates before. The FIFO reserve is the fewest
/// commands that still waited when the next target of a motion came.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk summary run.pcapng
  ecmsk summary --json run.pcapng | jq .alarms
  ecmsk summary --from 3.5 --to 4 run.pcapng
  ecmsk summary --fail-on 'alarm,gap,following-error>500,torque>90' --junit found.xml run.pcapng
  ecmsk summary --html found.html run.pcapng
  ecmsk summary recordings
  ecmsk summary --by day --html trends.html flight

Exit code: 0, whatever went wrong, unless --exit-code or --fail-on is given; 1 if the recording cannot be read.")]
pub struct Args {
    /// The recording or capture, or a folder with some; - for standard input
    #[arg(value_name = "FILE|DIR", value_hint = ValueHint::AnyPath)]
    file: PathBuf,

    #[command(flatten)]
    times: TimeOptions,

    /// Bytes of a slot, 12 or 16 [default: from the recording, else from its CRCs]
    #[arg(long, visible_alias = "slot", value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// In a capture with several boards, use the one at BUS.DEVICE
    #[arg(long, value_name = "BUS.DEVICE", value_parser = parse_device)]
    device: Option<Address>,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    /// Show trends, with a line for each recording, hour or day (UTC) [default for a folder: recording, and for more than 60
    /// of them hour or day]
    #[arg(long, value_name = "PART")]
    by: Option<trends::By>,

    /// Print one JSON object
    #[arg(long)]
    json: bool,

    /// End with exit code 1 if the summary reports anything that went wrong, or if the recording is incomplete
    #[arg(long)]
    exit_code: bool,

    /// End with exit code 1 if one of these happened, and print which: any (as --exit-code), alarm, held-back (a drive held
    /// its axis back: internal limit active), state, gap, or an axis went beyond a limit: following-error>COUNTS,
    /// target-step>COUNTS, velocity>COUNTS_PER_S, torque>PERCENT. With a machine file, limits may be in units, as in
    /// following-error>0.5mm
    #[arg(long, value_name = "REASON,..", value_delimiter = ',', value_parser = FailOn::parse)]
    fail_on: Vec<FailOn>,

    /// Write the reasons of --fail-on as test cases to this file, as JUnit XML; without --fail-on the one reason `any`
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    junit: Option<PathBuf>,

    /// Write a page for a browser to this file: the summary, the axes, the alarms, and a picture of each bad moment
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    html: Option<PathBuf>,

    #[command(flatten)]
    overwrite: OverwriteOption,
}

/// Why a file of `ecmsk summary` was not written.
#[derive(Debug, thiserror::Error)]
pub enum SummaryError {
    /// The file is the recording itself.
    #[error("{} is the recording; name another file with {option}", .file.display())]
    SameFile {
        /// The path of the file.
        file: PathBuf,
        /// The option that names the file.
        option: &'static str,
    },
    /// Standard input is named, but the page needs its recording twice.
    #[error("the page of --html needs the recording twice, and standard input can be read once; save it to a file")]
    Stdin,
    /// The folder cannot be read.
    #[error("{}: {source}; name a folder with recordings that you may read", .folder.display())]
    Folder {
        /// The path of the folder.
        folder: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// No file of the folder is a recording with frames.
    #[error("{} has no recording with frames; record into it with `ecmsk exec --record` or `--flight`", .folder.display())]
    NoRecording {
        /// The path of the folder.
        folder: PathBuf,
    },
    /// Trends by hours or days were requested, and the recording has a virtual clock.
    #[error("{} has a virtual clock, which knows no hours and days; leave --by out", .file.display())]
    NoDays {
        /// The path of the recording.
        file: PathBuf,
    },
    /// Trends were requested for a part of each recording.
    #[error("--from, --to and --around count from the beginning of one recording; name one for them, without --by")]
    TimesOfTrends,
    /// Trends were requested from standard input.
    #[error("--by needs a file, since it looks at its beginning first; save standard input to one")]
    TrendsOfStdin,
    /// A file cannot be written, or is there and stays.
    #[error(transparent)]
    File(#[from] OutputFileError),
}

/// Runs `ecmsk summary`: reads the recording to its end and prints what went wrong in it, or with a folder or `--by` the
/// trends. The exit code is 1 if `--exit-code` or `--fail-on` asks for it.
///
/// # Errors
/// [`CliError`] if the recording or the machine file cannot be read, or an output file or standard output cannot be written.
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let is_file = args.file.as_os_str() != "-";
    args.check_files()?;
    if args.by.is_some() || is_file && args.file.is_dir() {
        return if is_file { trends::run(args) } else { Err(SummaryError::TrendsOfStdin.into()) };
    }
    let open = || Frames::open_board(&args.file, args.slot_size, args.device);
    let mut frames = open()?;
    let machine = machine_option::of_recording(args.machine.as_deref(), frames.carried().as_deref())?;
    let times = args.times.times();
    let (mut events, mut extremes) = (Events::new(times), Extremes::new(times));
    let mut survey = args.html.is_some().then(Survey::default);
    let walked = frames.walk(i64::MAX, |framed| {
        extremes.frame(framed);
        events.frame(framed);
        survey.iter_mut().for_each(|survey| survey.frame(framed));
    })?;
    // The summary of the frames before a damage is still printed.
    frames.note_zero();
    frames.note_walked(&walked);
    if !events.is_any() && walked.frames > 0 {
        say("note", &format_args!("none of {} frames is left; change --from, --to or --around", walked.frames));
    }
    let lacks = frames.lacks().unwrap_or_default();
    let is_whole = walked.damage.is_none() && lacks.is_nothing();
    let summary = events.summary(walked.damage.is_none() && lacks.missing == 0 && lacks.not_ended == 0);
    let axes: Vec<_> = extremes.axes().collect();
    if args.json {
        let mut json = json(&summary, machine.as_ref());
        let axis = |(slave, axis): &(usize, &_)| extremes::axis_json(*slave, axis, machine.as_ref());
        json["axes"] = axes.iter().map(axis).collect();
        output::print(format!("{json}\n"))?;
    } else {
        let line = |(slave, axis): &(usize, &_)| extremes::line(*slave, axis, machine.as_ref()) + "\n";
        let lines: String = axes.iter().map(line).collect();
        output::print(format!("{}{lines}", text(&summary, machine.as_ref())))?;
    }
    if let (Some(file), Some(survey)) = (&args.html, &survey) {
        let page = page::Page { args, summary: &summary, axes: &axes, events: &events, machine: machine.as_ref() };
        args.page(file).write(page.html(open()?, survey)?.as_bytes()).map_err(SummaryError::from)?;
    }
    let reasons = args.reasons();
    let failures = |asked: &FailOn| asked.reason.failures(&summary, is_whole, &axes, machine.as_ref());
    args.end(&reasons, &reasons.iter().map(failures).collect::<Vec<_>>(), summary.is_empty() && is_whole)
}

impl Args {
    /// The reasons to fail that are looked for: those of `--fail-on`; without it, any for `--junit`.
    fn reasons(&self) -> Vec<FailOn> {
        if self.fail_on.is_empty() && self.junit.is_some() { vec![FailOn::any()] } else { self.fail_on.clone() }
    }

    /// Writes the file of `--junit`, prints why the run has failed, and returns the exit code. `failures` has the lines of each
    /// reason.
    fn end(&self, reasons: &[FailOn], failures: &[Vec<String>], is_clean: bool) -> Result<ExitCode, CliError> {
        if let Some(file) = &self.junit {
            let case = |(reason, failures): (&FailOn, &Vec<String>)| {
                let failure = (!failures.is_empty()).then(|| failures.join("; "));
                Case { name: reason.text.clone(), failure, time: Duration::ZERO }
            };
            let cases: Vec<Case> = reasons.iter().zip(failures).map(case).collect();
            junit::write(&self.results(file), &format!("ecmsk summary {}", self.file.display()), &cases)
                .map_err(SummaryError::from)?;
        }
        let failed = self.fail_on.iter().zip(failures).flat_map(|(_, failures)| failures);
        let failed = failed.inspect(|failure| say("failed", failure)).count() > 0;
        Ok(if failed || self.exit_code && !is_clean { ExitCode::FAILURE } else { ExitCode::SUCCESS })
    }

    /// Checks the output files before a long recording is read.
    fn check_files(&self) -> Result<(), SummaryError> {
        if self.html.is_some() && self.file.as_os_str() == "-" {
            return Err(SummaryError::Stdin);
        }
        let (results, page) = (self.junit.as_deref(), self.html.as_deref());
        for output in [results.map(|file| self.results(file)), page.map(|file| self.page(file))].into_iter().flatten() {
            if is_same_file(&self.file, output.file) {
                return Err(SummaryError::SameFile { file: output.file.to_owned(), option: output.option });
            }
            output.check()?;
        }
        Ok(())
    }

    /// The file of `--junit`.
    const fn results<'a>(&self, file: &'a Path) -> OutputFile<'a> {
        junit::output(file, self.overwrite.replace())
    }

    /// The file of `--html`.
    const fn page<'a>(&self, file: &'a Path) -> OutputFile<'a> {
        OutputFile { file, option: "--html", kind: Kind::Page, replace: self.overwrite.replace() }
    }
}

/// The summary as text, one line for each problem, and what the machine file adds: the texts of alarms, and where its axes
/// were held back.
fn text(summary: &Summary, machine: Option<&MachineFile>) -> String {
    format!("{summary}{}{}", alarm_texts(summary, machine), held_back_texts(summary, machine))
}

/// For each axis of the machine file that was held back by its drive, a line with its name and its position in its unit.
fn held_back_texts(summary: &Summary, machine: Option<&MachineFile>) -> String {
    let axes = summary.held_back().filter_map(|(held, _)| {
        let axis = machine?.axis_of(held.slave)?;
        Some(format!("axis {}: held back at {}\n", axis.name, machine_option::in_unit(axis, held.position.into())))
    });
    axes.collect()
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
            // Three decimals, as in the text.
            let at_s = alarm.at_ns.map(|at_ns| (at_ns as f64 / 1e6).round() / 1e3);
            object!({"slave": alarm.slave, "error_code": alarm.code, "meaning": meaning, "times": times, "at_s": at_s})
        })
        .collect();
    let held_back: Vec<_> = summary
        .held_back()
        .map(|(held, times)| {
            let at_s = held.at_ns.map(|at_ns| (at_ns as f64 / 1e6).round() / 1e3);
            object!({"slave": held.slave, "position_counts": held.position, "times": times, "at_s": at_s})
        })
        .collect();
    let states: Vec<_> = summary
        .states_failed()
        .map(|(failed, times)| object!({"state": failed.state, "text": failed.to_string(), "times": times}))
        .collect();
    let messages: Vec<_> = summary.messages().map(|(text, times)| object!({"text": text, "times": times})).collect();
    let counts: serde_json::Map<String, Value> =
        summary.counts().map(|(name, value)| (name.to_owned(), value.into())).collect();
    object!({"counts": counts, "alarms": alarms, "held_back": held_back, "states_failed": states, "said": messages})
}
