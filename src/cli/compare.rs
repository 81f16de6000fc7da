//! `ecmsk compare`: two recordings of the same program, held against each other command by command.

pub mod json;
mod picture;

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueHint;
use ecmsk::compare::{CompareError, Comparison, Observed, Options, Source, Steps, compare_steps};
use ecmsk::link::record::Address;
use ecmsk::sk::SlotSize;

use super::error::say;
use super::plot::{self, PlotError};
use super::{output, recording, slot_size};
use picture::Picture;

/// Exit code for recordings that differ, as diff(1) has it.
const DIFFERENT: u8 = 1;
/// Exit code for what could not be compared; of a wrong command line too.
pub const TROUBLE: u8 = 2;

/// Compare two recordings of the same program, command by command: does the other board answer the same?
///
/// Commands are held against each other by their numbers and not by time: frames of nothing but GET_STATUS, the number of
/// reports and when they came do not count. Of a command's answers the last one does, with what the program moved on: the
/// states, statuswords, error codes, positions, inputs and SDO results of all slaves, and faults that came and went.
#[derive(clap::Args)]
#[command(after_help = "\
Exit codes, as those of diff: 0 the recordings are equal, 1 they differ, 2 they could not be compared.

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

    /// Of captures these devices alone, by bus and address, as 1.5: of A, and of B if it is another one
    #[arg(long, value_name = "BUS.ADDRESS", value_delimiter = ',', value_parser = recording::parse_device)]
    device: Vec<Address>,
}

/// What counts as equal, and how it is told.
#[derive(clap::Args)]
pub struct How {
    /// Positions may be so many counts apart
    #[arg(long, value_name = "COUNTS", default_value_t = 0)]
    tolerance: u32,

    /// Bits of a statusword that count, e.g. 0x006F for the CiA 402 state alone
    #[arg(long, value_name = "MASK", default_value = "0xFFFF", value_parser = parse_mask)]
    statusword_mask: u16,

    /// A frame that is sent again and again counts as one: for programs that repeat it until it is carried out
    #[arg(long)]
    ignore_repeats: bool,

    /// Print one JSON object
    #[arg(long)]
    pub json: bool,

    /// Make a picture of the positions in both, with the first difference marked
    #[arg(long, value_name = "SVG", value_hint = ValueHint::FilePath)]
    pub plot: Option<PathBuf>,

    /// Bytes of a slot in both, 12 or 16 [default: what the recordings say, else what CRCs and slots fit, else 12]
    #[arg(long, visible_alias = "slot", value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,
}

impl How {
    /// What counts as equal.
    pub const fn options(&self) -> Options {
        Options {
            tolerance_counts: self.tolerance,
            statusword_mask: self.statusword_mask,
            ignore_repeats: self.ignore_repeats,
            slot: self.slot_size,
        }
    }
}

/// What the two runs are called, and where their picture goes.
pub struct Names {
    /// Of A and B.
    pub runs: [String; 2],
    /// The picture.
    pub plot: Option<PathBuf>,
}

/// Why nothing was compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareVerbError {
    /// See [`CompareError`].
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// See [`PlotError`].
    #[error(transparent)]
    Plot(#[from] PlotError),
    /// Recordings are read more than once.
    #[error("standard input cannot be compared, it can be read only once; save it to a file and name that")]
    Stdin,
    /// More devices than captures.
    #[error("--device names {found} devices for two captures; name one for A and one for B, as 1.5,1.6")]
    TooManyDevices {
        /// Devices named.
        found: usize,
    },
    /// The picture has nothing to show.
    #[error("no axis moves in either recording: there is nothing to plot; leave --plot out")]
    NothingToPlot,
    /// Standard output took no more.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(io::Error),
}

/// Compares, and gives the exit code.
pub fn run(args: &Args) -> Result<ExitCode, CompareVerbError> {
    if [&args.a, &args.b].iter().any(|file| file.as_path() == Path::new("-")) {
        return Err(CompareVerbError::Stdin);
    }
    if args.device.len() > 2 {
        return Err(CompareVerbError::TooManyDevices { found: args.device.len() });
    }
    let options = args.how.options();
    let names = Names { runs: [&args.a, &args.b].map(|file| file.display().to_string()), plot: args.how.plot.clone() };
    let mut runs = Runs::open(args, &options)?;
    let found = compare_steps(
        Steps::new(&mut runs.a, runs.size, options.ignore_repeats),
        Steps::new(&mut runs.b, runs.size, options.ignore_repeats),
        &options,
    );
    runs.check()?;
    if let Some(file) = &args.how.plot {
        let Runs { a, b, size } = Runs::open(args, &options)?;
        let steps = |source| Steps::new(source, size, options.ignore_repeats);
        let drawing = draw(steps(a), steps(b), &names, &found)?;
        plot::save(file, "--plot", &[&args.a, &args.b], &drawing)?;
    }
    let text = if args.how.json { json::object(&names, &found).to_string() + "\n" } else { text(&names, &found) };
    print(text, found.is_equal())
}

/// Prints what was found, and gives the exit code.
pub fn print(text: String, is_equal: bool) -> Result<ExitCode, CompareVerbError> {
    match output::print(text) {
        // Whoever has seen enough of the words may still want the exit code.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => return Err(CompareVerbError::Output(error)),
        _ => {}
    }
    Ok(if is_equal { ExitCode::SUCCESS } else { ExitCode::from(DIFFERENT) })
}

/// Both recordings.
struct Runs {
    a: Source,
    b: Source,
    size: SlotSize,
}

impl Runs {
    fn open(args: &Args, options: &Options) -> Result<Self, CompareVerbError> {
        let devices = [args.device.first().copied(), args.device.last().copied()];
        let [a, b] =
            [Source::open(&args.a, options.slot, devices[0])?, Source::open(&args.b, options.slot, devices[1])?];
        let size = Source::common_size(&a, &b)?;
        Ok(Self { a, b, size })
    }

    /// What is to be said of the recordings, once they were read.
    fn check(&self) -> Result<(), CompareVerbError> {
        for (name, source) in [("A", &self.a), ("B", &self.b)] {
            tell(name, source)?;
        }
        Ok(())
    }
}

/// Says on standard error what there is to say of a recording, once it was read.
///
/// # Errors
/// Why it could not be.
pub fn tell(name: &str, source: &Source) -> Result<(), CompareError> {
    source.check()?;
    if source.is_size_assumed() {
        recording::note_assumed(name, source.size());
    }
    if let Some(damage) = source.damage() {
        say("note", &format_args!("{name}: {damage}"));
    }
    recording::note_left_out(name, &source.skipped());
    if source.missing() > 0 {
        let missing = source.missing();
        say("note", &format_args!("{name}: {missing} frames are missing; record to a faster disk to have them all"));
    }
    Ok(())
}

/// The picture of two runs.
pub fn draw<A, B>(
    mut a: Steps<A>,
    mut b: Steps<B>,
    names: &Names,
    found: &Comparison,
) -> Result<String, CompareVerbError>
where
    A: Iterator<Item = Observed>,
    B: Iterator<Item = Observed>,
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

/// What was found, in words.
pub fn text(names: &Names, found: &Comparison) -> String {
    let [a, b] = &names.runs;
    let picture = names.plot.as_ref().map_or_else(String::new, |file| format!("picture: {}\n", file.display()));
    format!("A is {a}\nB is {b}\n{found}\n{picture}")
}

fn parse_mask(text: &str) -> Result<u16, String> {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let mask = digits.map_or_else(|| text.parse().ok(), |digits| u16::from_str_radix(digits, 16).ok());
    mask.ok_or_else(|| "allowed: 16 bits, as 0x006F".to_owned())
}
