//! `ecmsk migrate`: whether a recorded program runs on an ECM-XF, and how the chip has to be set up.
//!
//! Files: `text.rs`, `json.rs`, `picture.rs`: the three ways in which the result is shown.

mod json;
mod picture;
mod text;

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueHint;
use ecmsk::compare::{CompareError, RecordedRun};
use ecmsk::link::uri::LinkUri;
use ecmsk::migrate::{Migration, Setting, Survey, Verdict};
use ecmsk::recording::{Address, Clock};
use ecmsk::sk::SlotSize;

use super::compare::{TROUBLE, tell};
use super::output_file::OverwriteOption;
use super::plot::{self, PlotError};
use super::stderr::say;
use super::{output, recording, slot_size};
use picture::Picture;

/// Exit code for a program that runs with differences, or does not run.
const DIFFERENT: u8 = 1;
/// The SPI clock rates that the key `speed=` of `xf-spi:` accepts, in Hz.
const SPEEDS: std::ops::RangeInclusive<u32> = 100_000..=96_000_000;

/// Check from a recording whether a program runs on an ECM-XF, the board's successor
///
/// The recording is one of the program on its present board, or on `sim:`. The report says which commands, modes,
/// cycles, kinds of slaves and objects the program uses and whether the chip has them, how long the PC stalled, and
/// which packets and clock the cycle needs. It ends with the line for ecmsk.toml. docs/MIGRATION.md explains the
/// differences row by row.
#[derive(clap::Args)]
#[command(after_help = "\
Exit codes, as those of diff: 0 the program runs as it is, 1 it runs with differences or not, 2 it could not be said, or it
runs as it is only as far as a recording goes that is not whole or never reaches OP.

Examples:
  ecmsk migrate run.pcapng
  ecmsk migrate run.pcapng --speed 8M --plot stalls.svg
  ecmsk migrate windows.pcapng --device 2.7 --json | jq .links.machine")]
pub struct Args {
    /// The recording (pcapng), or a capture of usbmon or USBPcap (pcapng, pcap)
    #[arg(value_name = "RECORDING", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// SPI clock of the machine, as in `xf-spi:`; jumper wires carry less than 10M
    #[arg(long, value_name = "HZ", default_value = "24M", value_parser = parse_speed)]
    speed: u32,

    /// Accept a recording that is cut off, was not ended, lacks frames or never reaches OP: the exit code is 0 if
    /// everything in it runs
    #[arg(long)]
    allow_incomplete: bool,

    /// Print one JSON object
    #[arg(long)]
    json: bool,

    /// Write a picture of the FIFO level and the host's pauses, with the time that `ahead=` bridges, to this file
    #[arg(long, value_name = "PICTURE", value_hint = ValueHint::FilePath)]
    plot: Option<PathBuf>,

    #[command(flatten)]
    overwrite: OverwriteOption,

    /// Bytes of a slot, 12 or 16 [default: from the recording, else from its CRCs and slots, else 12]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// In a capture, use only this device, by its bus and address, e.g. 1.5
    #[arg(long, value_name = "BUS.ADDRESS", value_parser = recording::parse_device)]
    device: Option<Address>,
}

/// Why `ecmsk migrate` has not judged the recorded program, or has not printed or drawn the result.
#[derive(Debug, thiserror::Error)]
pub enum MigrateVerbError {
    /// The recording cannot be read or evaluated.
    #[error(transparent)]
    Recording(#[from] CompareError),
    /// The picture of `--plot` cannot be drawn or written.
    #[error(transparent)]
    Plot(#[from] PlotError),
    /// Standard input is named, but a recording is read more than once.
    #[error("standard input cannot be read twice; save it to a file and name that")]
    Stdin,
    /// The recorded program never reaches OP, so that the picture of `--plot` would be empty.
    #[error("{} never reaches OP: there is nothing to plot; leave --plot out, or record a program that moves", .file.display())]
    NothingToPlot {
        /// The path of the recording.
        file: PathBuf,
    },
    /// Standard output cannot be written to.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(io::Error),
}

/// The result of evaluating a recording, with the facts about the recording that are printed beside it.
struct Report<'a> {
    file: &'a Path,
    found: &'a Migration,
    /// The link in the recording, as text for users; `None` for a capture by another tool, which has none.
    link: Option<String>,
    /// Whether the recorded board had its slaves behind a chip already.
    is_behind_chip: bool,
    clock: Clock,
    /// What the recording lacks to be the whole run; `None` if it is complete.
    lacks: Option<String>,
    plot: Option<&'a Path>,
}

/// Reads the recording and prints the result; returns the exit code.
pub fn run(args: &Args) -> Result<ExitCode, MigrateVerbError> {
    if args.file == Path::new("-") {
        return Err(MigrateVerbError::Stdin);
    }
    if let Some(file) = &args.plot {
        plot::check(file, "--plot", &[&args.file], args.overwrite.replace())?;
    }
    let mut source = RecordedRun::open(&args.file, args.slot_size, args.device)?;
    let mut survey = Survey::new(source.size());
    for observed in source.by_ref() {
        survey.frame(&observed);
    }
    let name = args.file.display().to_string();
    let lacks = tell(&name, &source)?;
    let clock = source.meta().map_or(Clock::Real, |meta| meta.clock);
    let link = source.meta().and_then(|meta| LinkUri::parse(&meta.link).ok());
    let is_behind_chip = link.as_ref().is_some_and(|link| link.scheme().has_chip());
    let setting = Setting { clock_hz: args.speed, clock, slot: source.size(), is_behind_chip };
    let mut found = Migration::of(&survey, &setting);
    let given = link.iter().flat_map(LinkUri::keys).find(|(key, _)| *key == "slaves");
    if let (Some(plan), Some((_, slaves))) = (&mut found.plan, given) {
        plan.links.with_slaves(slaves);
    }
    if found.op.is_none() {
        let what = "it never reaches OP: of its motion and its host nothing is known; record it while it moves";
        say("note", &format_args!("{name}: {what}"));
    }
    let report = Report {
        file: &args.file,
        found: &found,
        link: source.meta().map(recording::link_name),
        is_behind_chip,
        clock,
        lacks,
        plot: args.plot.as_deref(),
    };
    if let Some(file) = &args.plot {
        let picture = plot::check(file, "--plot", &[&args.file], args.overwrite.replace())?;
        picture.save(&draw(args, &report)?)?;
    }
    let text = if args.json { json::object(&report).to_string() + "\n" } else { text::of(&report) };
    match output::print(text) {
        // A reader that closes the pipe early may still want the exit code.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(MigrateVerbError::Output(error)),
        _ => Ok(ExitCode::from(report.code(args.allow_incomplete))),
    }
}

/// Draws the picture, for which the recording is read once more.
fn draw(args: &Args, report: &Report) -> Result<plot::Sheet, MigrateVerbError> {
    let nothing = || MigrateVerbError::NothingToPlot { file: args.file.clone() };
    let op = report.found.op.ok_or_else(nothing)?;
    let mut source = RecordedRun::open(&args.file, args.slot_size, args.device)?;
    let mut survey = Survey::new(source.size());
    let mut picture = Picture::new(op, report.found.cycle);
    for observed in source.by_ref() {
        let seen = survey.frame(&observed);
        picture.frame(observed.at_ns, &seen);
    }
    source.check()?;
    picture.draw(report).ok_or_else(nothing)
}

impl Report<'_> {
    /// The worst of all verdicts: `yes`, `differs` or `no`.
    fn runs(&self) -> &'static str {
        let words: Vec<_> = self.found.verdicts().map(Verdict::word).collect();
        ["no", "differs"].into_iter().find(|word| words.contains(word)).unwrap_or("yes")
    }

    fn code(&self, allow_incomplete: bool) -> u8 {
        let is_whole = self.lacks.is_none() && self.found.op.is_some();
        match self.runs() {
            "yes" if is_whole || allow_incomplete => 0,
            "yes" => TROUBLE,
            _ => DIFFERENT,
        }
    }
}

/// Parses a clock rate in Hz, with an optional `k` or `M`.
fn parse_speed(text: &str) -> Result<u32, String> {
    let (digits, factor) = match text.as_bytes().last() {
        Some(b'M') => (&text[..text.len() - 1], 1_000_000),
        Some(b'k') => (&text[..text.len() - 1], 1000),
        _ => (text, 1),
    };
    let hz = digits.parse::<u32>().ok().and_then(|number| number.checked_mul(factor));
    hz.filter(|hz| SPEEDS.contains(hz)).ok_or_else(|| "allowed: 100k to 96M".to_owned())
}
