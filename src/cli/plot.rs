//! `ecmsk plot`: a recording as a picture, what was commanded and what the drives did.

pub mod chart;
pub mod decimate;
mod follow;
pub mod panel;
mod series;
mod states;
pub mod style;
mod survey;

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use clap::ValueHint;
use ecmsk::link::record::{Address, RecordError};
use ecmsk::recording::InOrder;
use ecmsk::sk::{CommandId, SlotSize};

use super::error::{CliError, say};
use super::filter::{Command, Slaves, Times, nanoseconds, parse_seconds};
use super::recording::{self, Framed, Frames};
use super::{output, slot_size};
use series::{AxisLines, Series};
use survey::Survey;

/// Axes that a plot can tell apart by their colours.
pub const MAX_AXES: usize = 8;

/// Plot a recording as SVG: target and actual position, states, torque and FIFO level over time
///
/// The plot shows the time in OP; it is shaded where a drive is homing, has a fault or is not enabled. Targets stand where they were sent; they wait in the FIFO before they are executed.
/// Prints where the plot lies.
#[derive(clap::Args)]
#[command(after_help = "\
Times are seconds since the recording's first frame, as in `ecmsk dump`.

Examples:
  ecmsk plot run.pcapng
  ecmsk plot run.pcapng --axes 1,2 --from 3.5 --to 4 --difference -o start.svg")]
pub struct Args {
    /// The recording (pcapng), as the key `record` of a link writes it, or a capture of usbmon or USBPcap (pcapng, pcap)
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// Where the plot goes; `-` is standard output [default: FILE with the ending .svg]
    #[arg(short, long, value_name = "SVG", value_hint = ValueHint::FilePath)]
    output: Option<PathBuf>,

    /// Slaves to show, at most 8; comma list with ranges [default: those that were moved, else all drives]
    #[arg(long, visible_alias = "slots", value_name = "LIST", value_delimiter = ',', value_parser = Slaves::parse)]
    axes: Vec<Slaves>,

    /// Show an axis only where its slot asks for or answers one of these commands, as CSP or GO_HOME; comma list
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = Command::parse)]
    commands: Vec<Command>,

    /// Leave out what is before this time, as 1.5, 1.5s or 1500ms
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = parse_seconds)]
    from: Option<f64>,

    /// Leave out what is after this time
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = parse_seconds)]
    to: Option<f64>,

    /// Show the following difference too: the target executed in a cycle minus the actual position reported by it
    #[arg(long)]
    difference: bool,

    /// Bytes of a slot, 12 or 16 [default: what the recording says, else what the CRCs fit, else 12]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// Of a capture this device alone, by its bus and address, as 1.5
    #[arg(long, value_name = "BUS.ADDRESS", value_parser = recording::parse_device)]
    device: Option<Address>,
}

/// Why there is no plot.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// A plot reads its recording twice.
    #[error("a plot cannot read standard input; name a file")]
    Stdin,
    /// The network never ran.
    #[error(
        "{} has no response in OP ({frames} frames), and a plot shows what happens in OP; record a program that goes there, or look at this one with `ecmsk dump`",
        .file.display()
    )]
    NoOp {
        /// The recording.
        file: PathBuf,
        /// Frames it has.
        frames: u64,
    },
    /// The times asked for lie elsewhere.
    #[error("no time in OP is left: {asked}, and the recording is in OP from {op}; change --from or --to")]
    NothingInRange {
        /// The times asked for.
        asked: String,
        /// The times there are.
        op: String,
    },
    /// The axes never had one of these commands.
    #[error(
        "nothing is left of {}: no slot asks for or answers {commands} in the time shown; change --commands, --axes, --from or --to", axes_list(.axes)
    )]
    NoSuchCommand {
        /// Those asked for.
        commands: String,
        /// The axes looked at.
        axes: Vec<u8>,
    },
    /// More than colours.
    #[error("{found} axes do not fit one plot, at most {MAX_AXES} do; name fewer with --axes")]
    TooManyAxes {
        /// Axes asked for.
        found: usize,
    },
    /// There is nothing of that axis.
    #[error("axis {axis} has no slot in frames of {}-byte slots; name axes from 1 to {} with --axes", .size.bytes(), .size.max_slaves())]
    NoSuchAxis {
        /// The axis.
        axis: u8,
        /// The frames' slot size.
        size: SlotSize,
    },
    /// An axis that the recording says nothing of.
    #[error("axis {axis} is empty: no slave has its slot in OP, and no command is for it; {}", others(.axes))]
    EmptyAxis {
        /// The axis.
        axis: u8,
        /// Those that are not.
        axes: Vec<u8>,
    },
    /// The plot would replace the recording.
    #[error("the plot would replace the recording {}; name another file with {option}", .file.display())]
    SameFile {
        /// The file.
        file: PathBuf,
        /// What names it.
        option: &'static str,
    },
    /// The plot cannot be written.
    #[error("cannot write {}: {source}; name another file with {option}", .file.display())]
    Write {
        /// The file.
        file: PathBuf,
        /// What names it.
        option: &'static str,
        /// The system's words.
        source: io::Error,
    },
    /// The picture could not be made.
    #[error("cannot draw: {reason}; try fewer axes with --axes, or a shorter time with --from and --to")]
    Draw {
        /// The library's words.
        reason: String,
    },
}

/// Makes the plot.
pub fn run(args: &Args) -> Result<(), CliError> {
    if args.file == Path::new("-") {
        return Err(PlotError::Stdin.into());
    }
    let asked = args.axes();
    if asked.len() > MAX_AXES {
        return Err(PlotError::TooManyAxes { found: asked.len() }.into());
    }
    let mut survey = Survey::default();
    let device = recording::board(&args.file, args.device)?;
    let mut recording = Frames::open(&args.file, args.slot_size, device)?;
    let Walked { frames, damage } = walk(&mut recording, |framed| survey.frame(framed))?;
    recording.note_missing();
    let Some(op) = survey.op() else {
        let no_op = PlotError::NoOp { file: args.file.clone(), frames };
        return Err(damage.map_or(no_op.into(), CliError::from));
    };
    let axes = axes(asked, &survey)?;
    let times = Times { from: args.from, to: args.to };
    let window =
        op.cut(times).ok_or_else(|| PlotError::NothingInRange { asked: times.to_string(), op: op.to_string() })?;
    let cycle_ns = args.difference.then(|| survey.cycle_ns());
    let commands = args.commands.iter().map(|command| command.code()).collect();
    let mut series = Series::new(window, &axes, survey.board(), cycle_ns).only(commands);
    walk(&mut Frames::open(&args.file, args.slot_size, device)?.quiet(), |framed| series.frame(framed))?;
    let lines = series.finish();
    if !args.commands.is_empty() && lines.axes.iter().all(AxisLines::is_empty) {
        let names = args.commands.iter().map(|command| CommandId::from_code(command.code()).to_string());
        let commands = names.collect::<Vec<_>>().join(", ");
        return Err(PlotError::NoSuchCommand { commands, axes }.into());
    }
    let stretch = [window.from_ns, window.to_ns].map(|at_ns| style::number(seconds(at_ns), 3)).join(" to ");
    let file = args.file.display();
    let caption = chart::Caption {
        title: survey.link().unwrap_or_else(|| file.to_string()),
        about: format!("{stretch} s of {file}, {} frames", style::number(frames as f64, 0)),
        range: window.range(),
        axis: "time (s)",
    };
    let drawing = chart::draw(&panel::panels(lines), &caption)?;
    if let Some(damage) = damage {
        say("note", &damage);
    }
    let file = args.output.clone().unwrap_or_else(|| args.file.with_extension("svg"));
    if file == Path::new("-") {
        return Ok(output::print(drawing)?);
    }
    save(&file, "-o", &[&args.file], &drawing)?;
    Ok(output::print(format!("{}\n", file.display()))?)
}

/// Writes a plot to a file, named by that option, that is none of the recordings it was made of.
pub fn save(file: &Path, option: &'static str, recordings: &[&Path], drawing: &str) -> Result<(), PlotError> {
    let same = |recording: &&Path| {
        fs::canonicalize(file).ok().zip(fs::canonicalize(recording).ok()).is_some_and(|(a, b)| a == b)
    };
    if recordings.iter().any(same) {
        return Err(PlotError::SameFile { file: file.to_owned(), option });
    }
    fs::write(file, drawing).map_err(|source| PlotError::Write { file: file.to_owned(), option, source })
}

/// What a walk through the recording came by.
struct Walked {
    /// Its frames.
    frames: u64,
    /// Why it ends early, if it does: a program that was killed leaves such a recording, and what came before is whole.
    damage: Option<RecordError>,
}

/// Shows every frame of the recording in the order of time.
fn walk<R: Read>(recording: &mut Frames<R>, mut show: impl FnMut(&Framed)) -> Result<Walked, CliError> {
    let mut order = InOrder::default();
    let mut walked = Walked { frames: 0, damage: None };
    for framed in recording {
        match framed {
            Ok(framed) => {
                walked.frames += 1;
                order.push(framed.time_ns, framed).iter().for_each(&mut show);
            }
            Err(error @ (RecordError::Truncated { .. } | RecordError::Malformed { .. })) => walked.damage = Some(error),
            Err(error) => return Err(error.into()),
        }
    }
    while let Some(framed) = order.pop() {
        show(&framed);
    }
    Ok(walked)
}

impl Args {
    /// The axes asked for.
    fn axes(&self) -> Vec<u8> {
        let mut axes: Vec<u8> = self.axes.iter().flat_map(|slaves| slaves.numbers()).collect();
        axes.sort_unstable();
        axes.dedup();
        axes
    }
}

/// The axes to show: as asked, else as found.
fn axes(asked: Vec<u8>, survey: &Survey) -> Result<Vec<u8>, PlotError> {
    let size = survey.size();
    if let Some(axis) = asked.iter().copied().find(|axis| usize::from(*axis) > size.max_slaves()) {
        return Err(PlotError::NoSuchAxis { axis, size });
    }
    if let Some(axis) = asked.iter().copied().find(|axis| survey.is_empty(*axis)) {
        return Err(PlotError::EmptyAxis { axis, axes: survey.known() });
    }
    let mut axes = if asked.is_empty() { survey.axes() } else { asked };
    if axes.len() > MAX_AXES {
        let (all, shown) = (axes.len(), style::list(&axes[..MAX_AXES]));
        say("note", &format_args!("{all} axes, of which the plot shows {shown}; choose others with --axes"));
        axes.truncate(MAX_AXES);
    }
    Ok(axes)
}

/// What can be asked for instead.
fn others(axes: &[u8]) -> String {
    match axes {
        [] => "leave --axes out, for the FIFO alone".to_owned(),
        axes => format!("name some of {} with --axes", style::list(axes)),
    }
}

fn axes_list(axes: &[u8]) -> String {
    match axes {
        [axis] => format!("axis {axis}"),
        axes => format!("axes {}", style::list(axes)),
    }
}

/// A stretch of time, both ends included: nanoseconds since the recording's first frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    from_ns: i64,
    to_ns: i64,
}

impl Window {
    /// Of commands by their numbers: they stand where seconds would.
    pub const fn of_commands(count: u64) -> Self {
        Self { from_ns: command_place(1), to_ns: command_place(if count == 0 { 1 } else { count }) }
    }

    /// From left to right; a single moment gets some room around.
    pub fn range(self) -> std::ops::Range<f64> {
        let (from, to) = (seconds(self.from_ns), seconds(self.to_ns));
        if to > from { from..to } else { from - 0.001..to + 0.001 }
    }

    const fn contains(self, at_ns: i64) -> bool {
        self.from_ns <= at_ns && at_ns <= self.to_ns
    }

    /// The part between two times; `None` if nothing is left.
    fn cut(self, times: Times) -> Option<Self> {
        let from_ns = times.from.map_or(self.from_ns, |s| self.from_ns.max(nanoseconds(s)));
        let to_ns = times.to.map_or(self.to_ns, |s| self.to_ns.min(nanoseconds(s)));
        (from_ns <= to_ns).then_some(Self { from_ns, to_ns })
    }
}

impl std::fmt::Display for Window {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.3} s to {:.3} s", seconds(self.from_ns), seconds(self.to_ns))
    }
}

/// Where command n stands in a window of commands.
pub const fn command_place(n: u64) -> i64 {
    (n as i64).saturating_mul(1_000_000_000)
}

/// Nanoseconds as seconds.
fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}
