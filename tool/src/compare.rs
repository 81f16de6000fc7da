//! `ecmsk compare`: compares two recordings of the same program command by command.

pub mod json;
mod picture;

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueHint;
#[cfg(feature = "web")]
use ecmsk::compare::Difference;
use ecmsk::compare::{
    CompareError, CompareOptions, Comparison, Deviation, RecordedRun, Steps, TimedFrame, compare_steps,
};
use ecmsk::recording::Address;
use ecmsk::sk::SlotSize;

use super::board::whole;
use super::output_file::OverwriteOption;
use super::plot::{self, PlotError};
use super::stderr::say;
use super::{output, recording, slot_size};
use picture::Picture;

/// Exit code for recordings that differ, as diff(1) has it.
const DIFFERENT: u8 = 1;
/// Exit code if nothing could be compared, or the command line is wrong.
pub const TROUBLE: u8 = 2;

/// Compare two recordings of the same program, command by command: do both boards answer the same?
///
/// Commands are compared by their numbers and not by time. Frames with only GET_STATUS, the number of reports and their
/// times do not count. The program goes on after the last answer to a command, and that answer counts: states,
/// statuswords, error codes, positions, inputs and SDO results of all slaves, and faults that came and went.
#[derive(clap::Args)]
#[command(after_help = "\
Exit codes, as those of diff: 0 the recordings are equal, 1 they differ, 2 they could not be compared, or are equal only as
far as one of them goes that is not whole.

Examples:
  ecmsk compare board.pcapng model.pcapng --tolerance 3
  ecmsk compare before.pcapng after.pcapng --plot difference.svg
  ecmsk dump model.pcapng --from 1.2s --to 1.3s")]
pub struct Args {
    /// The first recording
    #[arg(value_name = "A", value_hint = ValueHint::FilePath)]
    a: PathBuf,

    /// The second recording
    #[arg(value_name = "B", value_hint = ValueHint::FilePath)]
    b: PathBuf,

    #[command(flatten)]
    how: How,

    /// In captures, use only these devices, by bus and address, e.g. 1.5: the one of A, and the one of B if it differs
    #[arg(long, value_name = "BUS.ADDRESS", value_delimiter = ',', value_parser = recording::parse_device)]
    device: Vec<Address>,
}

/// What counts as equal, and the form of the output.
#[derive(clap::Args)]
pub struct How {
    /// Positions may differ by so many counts
    #[arg(long, value_name = "COUNTS", default_value_t = 0)]
    tolerance: u32,

    /// Bits of a statusword that are compared, e.g. 0x006F for the CiA 402 state alone
    #[arg(long, value_name = "MASK", default_value = "0xFFFF", value_parser = parse_mask)]
    statusword_mask: u16,

    /// Count repetitions of a frame as one: for programs that repeat a command until it is carried out
    #[arg(long)]
    ignore_repeats: bool,

    /// Answers may come at most so many cycles later in one recording than in the other. With 0, both boards must have
    /// answered when the program went on [default: any number, and the same answer may be up to 24 cycles earlier or
    /// later]
    #[arg(long, value_name = "CYCLES")]
    latency: Option<u32>,

    /// Accept recordings that are cut off, were not ended or lack frames: they are equal if they do not differ up to
    /// their end
    #[arg(long)]
    allow_incomplete: bool,

    /// Print one JSON object
    #[arg(long)]
    pub json: bool,

    /// Write a picture of the positions in both recordings, with the first difference marked, to this file
    #[arg(long, value_name = "PICTURE", value_hint = ValueHint::FilePath)]
    pub plot: Option<PathBuf>,

    #[command(flatten)]
    overwrite: OverwriteOption,

    /// Bytes of a slot in both, 12 or 16 [default: from the recordings, else from their CRCs and slots, else 12]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// Former name of --slot-size
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse, hide = true, conflicts_with = "slot_size")]
    slot: Option<SlotSize>,
}

impl How {
    /// The file of `--plot`, checked.
    ///
    /// # Errors
    /// The errors of [`plot::check`].
    pub fn picture<'a>(&self, file: &'a Path, recordings: &[&Path]) -> Result<plot::Picture<'a>, PlotError> {
        plot::check(file, "--plot", recordings, self.overwrite.replace())
    }

    /// The options of the command line that decide what counts as equal.
    pub fn options(&self) -> CompareOptions {
        CompareOptions {
            tolerance_counts: self.tolerance,
            statusword_mask: self.statusword_mask,
            ignore_repeats: self.ignore_repeats,
            latency_cycles: self.latency,
            slot: slot_size::given(self.slot_size, self.slot),
            allow_incomplete: self.allow_incomplete,
        }
    }
}

/// The names of the two runs, whether they are complete, and where their picture is written to.
pub struct Names {
    /// The names of the two runs, A and B, for the output.
    pub runs: [String; 2],
    /// What each recording lacks to be the complete run; `None` if it is complete.
    pub lacks: [Option<String>; 2],
    /// The path to which the picture is written.
    pub plot: Option<PathBuf>,
}

/// Why the recordings were not compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareVerbError {
    /// A recording cannot be read, or the two cannot be compared.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The picture of `--plot` cannot be drawn or written.
    #[error(transparent)]
    Plot(#[from] PlotError),
    /// Standard input cannot be compared, because a recording is read more than once.
    #[error("standard input cannot be compared, it can be read only once; save it to a file and name that")]
    Stdin,
    /// `--device` names more than two devices, although two captures are compared.
    #[error("--device names {found} devices for two captures; name one for A and one for B, as 1.5,1.6")]
    TooManyDevices {
        /// The number of devices that the command line names.
        found: usize,
    },
    /// No axis moves in either recording, so that the picture of `--plot` would be empty.
    #[error("no axis moves in either recording: there is nothing to plot; leave --plot out")]
    NothingToPlot,
    /// Standard output cannot be written to.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(io::Error),
}

/// Compares the recordings; returns the exit code.
pub fn run(args: &Args) -> Result<ExitCode, CompareVerbError> {
    if [&args.a, &args.b].iter().any(|file| file.as_path() == Path::new("-")) {
        return Err(CompareVerbError::Stdin);
    }
    if args.device.len() > 2 {
        return Err(CompareVerbError::TooManyDevices { found: args.device.len() });
    }
    if let Some(file) = &args.how.plot {
        args.how.picture(file, &[&args.a, &args.b])?;
    }
    let options = args.how.options();
    let recordings =
        Recordings { files: [&args.a, &args.b], devices: [args.device.first().copied(), args.device.last().copied()] };
    let mut runs = recordings.open(&options)?;
    let found = compare_steps(
        Steps::new(&mut runs.a, runs.size, options.ignore_repeats),
        Steps::new(&mut runs.b, runs.size, options.ignore_repeats),
        &options,
    );
    let lacks = runs.check()?;
    let files = recordings.files.map(|file| file.display().to_string());
    let names = Names { runs: files, lacks, plot: args.how.plot.clone() };
    if let Some(file) = &args.how.plot {
        let Runs { a, b, size } = recordings.open(&options)?;
        let steps = |source| Steps::new(source, size, options.ignore_repeats);
        let drawing = draw(steps(a), steps(b), &names, &found)?;
        args.how.picture(file, &[&args.a, &args.b])?.save(&drawing)?;
    }
    let settles = recordings.settling_tolerance(&options, &found)?;
    let text = if args.how.json {
        let mut object = json::object(&names, &found, &options);
        if let Some(counts) = settles {
            object["settling_tolerance_counts"] = counts.into();
        }
        object.to_string() + "\n"
    } else {
        let settles = settles.map(|counts| {
            format!(
                "positions alone differ, by no more than {counts} counts: --tolerance {counts} takes that for equal\n"
            )
        });
        text(&names, &found) + &settles.unwrap_or_default()
    };
    print(text, names.code(&found, &options))
}

/// The first difference of two recordings, and a tolerance of positions in counts with which there is none; `None` if they
/// are equal.
///
/// # Errors
/// A recording cannot be read, or the two cannot be compared.
#[cfg(feature = "web")]
pub fn first_difference(
    files: [&Path; 2],
    slot: Option<SlotSize>,
) -> Result<Option<(Difference, Option<u32>)>, CompareVerbError> {
    let recordings = Recordings { files, devices: [None; 2] };
    let options = CompareOptions { slot, allow_incomplete: true, ..CompareOptions::default() };
    let Runs { mut a, mut b, size } = recordings.open(&options)?;
    let found = compare_steps(Steps::new(&mut a, size, false), Steps::new(&mut b, size, false), &options);
    a.check()?;
    b.check()?;
    let settles = recordings.settling_tolerance(&options, &found)?;
    Ok(found.first.map(|first| (first, settles)))
}

/// \[OURS] The largest tolerance that is proposed, in counts. A larger difference is no noise of a measurement.
const PROPOSED_COUNTS_MAX: u32 = 1000;
/// \[OURS] The maximum number of additional comparisons to find a tolerance.
const PROPOSALS_MAX: usize = 8;

impl Names {
    /// The exit code of a comparison. Recordings that are equal but incomplete count as not compared.
    pub fn code(&self, found: &Comparison, options: &CompareOptions) -> u8 {
        match found.is_equal() {
            true if self.lacks.iter().all(Option::is_none) || options.allow_incomplete => 0,
            true => TROUBLE,
            false => DIFFERENT,
        }
    }
}

/// Prints the result; returns the exit code.
pub fn print(text: String, code: u8) -> Result<ExitCode, CompareVerbError> {
    match output::print(text) {
        // A reader that closes the pipe early may still want the exit code.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => return Err(CompareVerbError::Output(error)),
        _ => {}
    }
    Ok(ExitCode::from(code))
}

/// The two recordings of a comparison, opened for reading, and their common slot size.
struct Runs {
    a: RecordedRun,
    b: RecordedRun,
    size: SlotSize,
}

/// The files of two recordings, and in captures the devices to read.
struct Recordings<'a> {
    files: [&'a Path; 2],
    devices: [Option<Address>; 2],
}

impl Recordings<'_> {
    fn open(&self, options: &CompareOptions) -> Result<Runs, CompareVerbError> {
        let open = |at: usize| RecordedRun::open(self.files[at], options.slot, self.devices[at]);
        let (a, b) = (open(0)?, open(1)?);
        let size = RecordedRun::common_size(&a, &b)?;
        Ok(Runs { a, b, size })
    }

    /// Searches for a tolerance of positions, in counts, with which the recordings count as equal, to propose it to the user.
    /// `None` if they are equal already, if other values than positions differ, if positions differ by more than
    /// [`PROPOSED_COUNTS_MAX`], or if [`PROPOSALS_MAX`] comparisons are not enough to find a tolerance.
    fn settling_tolerance(
        &self,
        options: &CompareOptions,
        found: &Comparison,
    ) -> Result<Option<u32>, CompareVerbError> {
        if found.is_equal() {
            return Ok(None);
        }
        let (mut options, mut first) = (*options, found.first.clone());
        for _ in 0..PROPOSALS_MAX {
            let Some(difference) = first else { return Ok(Some(options.tolerance_counts)) };
            let apart = difference.what.iter().map(|what| match what {
                Deviation::Position { counts: [a, b], .. } => Some(a.abs_diff(*b)),
                _ => None,
            });
            let Some(most) = apart.collect::<Option<Vec<u32>>>().and_then(|apart| apart.into_iter().max()) else {
                return Ok(None);
            };
            if most > PROPOSED_COUNTS_MAX {
                return Ok(None);
            }
            options.tolerance_counts = most;
            let Runs { a, b, size } = self.open(&options)?;
            let steps = |source| Steps::new(source, size, options.ignore_repeats);
            first = compare_steps(steps(a), steps(b), &options).first;
        }
        Ok(None)
    }
}

impl Runs {
    /// Prints the notes on both recordings, once they were read; returns what each lacks to be complete.
    fn check(&self) -> Result<[Option<String>; 2], CompareVerbError> {
        Ok([tell("A", &self.a)?, tell("B", &self.b)?])
    }
}

/// Prints the notes on a recording, once it was read; returns what it lacks to be complete.
///
/// # Errors
/// The recording could not be read to its end.
pub fn tell(name: &str, source: &RecordedRun) -> Result<Option<String>, CompareError> {
    source.check()?;
    if source.is_size_assumed() {
        recording::note_assumed(name, source.size());
    }
    let lacks = source.shortcoming();
    if let Some(lacks) = &lacks {
        say("note", &format_args!("{name}: {lacks}"));
    }
    if let Some(jumps) = source.jumps() {
        say("note", &format_args!("{name}: {jumps}"));
    }
    recording::note_left_out(name, &source.skipped());
    Ok(lacks)
}

/// Draws the picture of two runs.
pub fn draw<A, B>(
    mut a: Steps<A>,
    mut b: Steps<B>,
    names: &Names,
    found: &Comparison,
) -> Result<plot::Sheet, CompareVerbError>
where
    A: Iterator<Item = TimedFrame>,
    B: Iterator<Item = TimedFrame>,
{
    let commands = found.counts.map(|counts| counts.commands);
    let mut picture = Picture::new(commands[0].max(commands[1]));
    loop {
        let (a, b) = (a.next(), b.next());
        if a.is_none() && b.is_none() {
            break;
        }
        picture.step(a.as_ref(), b.as_ref());
    }
    picture.draw(names, found)
}

/// The result of the comparison as text.
pub fn text(names: &Names, found: &Comparison) -> String {
    let [a, b] = &names.runs;
    let picture = names.plot.as_ref().map_or_else(String::new, |file| format!("picture: {}\n", file.display()));
    let whole = match &names.lacks {
        [None, None] => String::new(),
        [Some(_), None] => not_whole("A is"),
        [None, Some(_)] => not_whole("B is"),
        [Some(_), Some(_)] => not_whole("A and B are"),
    };
    let whole = if found.is_equal() { whole } else { String::new() };
    format!("A is {a}\nB is {b}\n{found}\n{whole}{picture}")
}

fn not_whole(which: &str) -> String {
    format!("as far as they go: {which} not whole (--allow-incomplete takes that for equal)\n")
}

fn parse_mask(text: &str) -> Result<u16, String> {
    whole(text).and_then(|mask| mask.try_into().ok()).ok_or_else(|| "allowed: 16 bits, as 0x006F".to_owned())
}
