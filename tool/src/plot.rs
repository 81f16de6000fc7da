//! `ecmsk plot`: draws a recording, with the commands and the motion of the drives.
//!
//! Files:
//!
//! - `survey.rs`, `series.rs`: the first and the second reading of the recording
//! - `axis.rs`, `states.rs`, `lanes.rs`, `speed.rs`, `path.rs`: the lines of an axis, its states, the bits of an IO slave,
//!   velocities, the path of two axes in their plane
//! - `decimate.rs`: reduces a line to the resolution of the picture
//! - `chosen.rs`: selects the slaves and diagrams
//! - `beside.rs`: a second recording that is drawn for comparison
//! - `panel.rs`, `layout.rs`, `style.rs`, `chart.rs`: the panels, their order, their style, and their drawing
//! - `svg.rs`, `png.rs`, `file.rs`: the formats and the file of the picture
//! - `html.rs`: the page of a recording, which a browser shows
//! - `pictures.rs`: pictures of short stretches, for the page of `summary`
//! - `error.rs`: why there is no plot

pub mod axis;
mod beside;
pub mod chart;
mod chosen;
pub mod decimate;
mod error;
mod file;
#[cfg(feature = "web")]
pub mod html;
mod lanes;
mod layout;
pub mod panel;
mod path;
pub mod pictures;
mod png;
pub mod series;
pub mod speed;
pub mod states;
pub mod style;
pub mod survey;
mod svg;
pub mod trend;

use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use clap::{ValueEnum, ValueHint};
use ecmsk::ecm::{Scale, Scales};
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::{Address, RecordError};
use ecmsk::sk::{CommandId, SlotSize};

use super::board::AxisWord;
use super::error::CliError;
use super::filter::{Command, TimeOptions, Times, nanoseconds};
use super::output_file::OverwriteOption;
use super::recording::{self, Frames, Walked};
use super::stderr::say;
use super::{machine_option, output, slot_size};
use beside::Other;
pub use chart::Sheet;
use chosen::{Asked, AxesWord, Chosen, Diagram, Room};
pub use error::PlotError;
use file::Format;
pub use file::{Picture, check};
use series::{Series, Subject};
use survey::Survey;

/// The most axes in a plot: there is a distinct colour for each.
pub const MAX_AXES: usize = 8;
/// How long before `--from` a recording in blocks is read, ns. \[OURS] This is more than the entries of a full FIFO take: the
/// target that is executed first in the range was sent up to 160 cycles before.
const READ_BEFORE_NS: i64 = 2_000_000_000;
/// The number of pixel columns to which a line is thinned: the width of a diagram.
pub const COLUMNS: u32 = style::WIDTH - style::LEFT - style::RIGHT;

/// Plot a recording as SVG, PNG or a page (.html): target and actual position, states, torque, IO and FIFO level over time
///
/// The plot shows the time in OP. It is shaded where a drive is homing, has a fault or is not enabled, and where the
/// FIFO was empty while an axis was moving, so that the board repeated the last target. Targets are drawn at the cycle
/// in which the board executed them, later than they were sent, since they wait in the FIFO. Prints the path of the
/// plot.
#[derive(clap::Args)]
#[command(after_help = "\
Times are seconds since the board was opened, as in `ecmsk dump`; in a capture since its first frame.

Examples:
  ecmsk plot run.pcapng
  ecmsk plot run.pcapng --axes 1,2 --from 3.5 --to 4 --difference -o start.svg
  ecmsk plot run.pcapng --counts-per-unit 10000 --unit mm --xy 1,2 --title 'The square' -o square.png
  ecmsk plot run.pcapng --panels velocity,io
  ecmsk plot board.pcapng --beside chip.pcapng -o both.svg
  ecmsk plot run.pcapng -o run.html")]
pub struct Args {
    /// The recording (pcapng), as the key `record` of a link writes it, or a capture of usbmon or USBPcap (pcapng, pcap)
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// File of the plot: SVG, PNG with the ending .png, or with .html a page for a browser (docs/WEB.md); `-` is standard
    /// output, as SVG [default: FILE with the ending .svg]
    #[arg(short, long, value_name = "PICTURE", value_hint = ValueHint::FilePath)]
    output: Option<PathBuf>,

    #[command(flatten)]
    overwrite: OverwriteOption,

    /// Title of the plot [default: the link that was recorded]
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,

    /// Slaves to show, at most 8; comma list with ranges, or names of the machine file [default: axes that were moved, else
    /// all drives; and the IO slaves with an input or output that was ever 1]
    #[arg(long, visible_alias = "slots", value_name = "LIST", value_delimiter = ',', value_parser = AxesWord::parse)]
    axes: Vec<AxesWord>,

    /// Show an axis only where its slot has one of these commands or an answer to it, e.g. CSP or GO_HOME; comma list
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = Command::parse)]
    commands: Vec<Command>,

    #[command(flatten)]
    times: TimeOptions,

    /// Show the following difference too: the target executed in a cycle minus the actual position reported by it
    #[arg(long)]
    difference: bool,

    /// Draw the positions of another recording, too, of the same program on another board; both OP phases begin at the
    /// same point
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    beside: Option<PathBuf>,

    /// Show the path of two axes in their plane, too, e.g. 1,2: the first one is the horizontal axis
    #[arg(long, value_name = "X,Y", value_parser = chosen::plane)]
    xy: Option<[AxisWord; 2]>,

    /// Show only these diagrams; comma list [default: all for which the recording has data, except difference, xy, and
    /// velocity of axes in CSP]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum)]
    panels: Vec<Diagram>,

    /// In a page, list when this condition becomes true; see `ecmsk find --help`
    #[arg(long, value_name = "EXPRESSION")]
    find: Option<String>,

    /// Counts per unit, for positions and speeds in mm or degrees: one number for all axes, or e.g. 1=5000,2=131072/360
    #[arg(long, value_name = "N", value_parser = Scales::parse, allow_hyphen_values = true)]
    counts_per_unit: Option<Scales>,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    /// The unit's name, as mm [default: units]
    #[arg(long, value_name = "NAME", requires = "counts_per_unit")]
    unit: Option<String>,

    /// Bytes of a slot, 12 or 16 [default: from the recording, else from its CRCs, else 12]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// In a capture, use only this device, by its bus and address, e.g. 1.5
    #[arg(long, value_name = "BUS.ADDRESS", value_parser = recording::parse_device)]
    device: Option<Address>,
}

/// Draws the picture and writes its file.
pub fn run(args: &Args) -> Result<(), CliError> {
    let output = args.output();
    #[cfg(feature = "web")]
    if html::is_asked(&output) {
        return html::run(args, &output);
    }
    if args.find.is_some() {
        return Err(PlotError::FindNeedsPage.into());
    }
    let (sheet, damage) = sheet(args)?;
    let told = || damage.iter().for_each(|damage| say("note", damage));
    if output == Path::new("-") {
        let drawing = Format::Svg.write(&sheet)?;
        told();
        let mut stdout = io::stdout().lock();
        return Ok(stdout.write_all(&drawing).and_then(|()| stdout.flush())?);
    }
    file::check(&output, "-o", &[&args.file], args.overwrite.replace())?.save(&sheet)?;
    told();
    Ok(output::print(format!("{}\n", output.display()))?)
}

/// Draws the picture and returns its bytes instead of writing it.
///
/// # Errors
/// [`CliError`] if the recording cannot be read or has no OP phase, if an option names an axis or a time that the recording
/// does not have, or if drawing fails.
pub fn picture(args: &Args) -> Result<Vec<u8>, CliError> {
    let format = Format::of(&args.output(), "-o")?;
    Ok(format.write(&sheet(args)?.0)?)
}

/// Draws the picture. Also returns the error that has ended a truncated recording.
fn sheet(args: &Args) -> Result<(Sheet, Option<RecordError>), CliError> {
    let output = args.output();
    let first = first(args, Room::PICTURE, || {
        if output != Path::new("-") {
            // The output file is checked before a long recording is read twice.
            file::check(&output, "-o", &[&args.file], args.overwrite.replace())?;
        }
        Ok(())
    })?;
    let (op, times) = (first.op, first.times);
    let other = args.beside.as_deref().map(|file| Other::read(file, args.slot_size, op)).transpose()?;
    if let Some(damage) = other.as_ref().and_then(Other::damage) {
        say("note", damage);
    }
    let other = other.and_then(|other| other.cut(times));
    let window = first.window()?;
    let First { survey, asked, chosen, device, frames, is_whole, damage, .. } = first;
    let reading = args.open(device)?.quiet();
    let panels = args.panels(reading, &asked, &chosen, &survey, window, other.as_ref())?;
    // The time axis ends with the longer one of both recordings.
    let shown = other.map_or(window, |other| window.with(other.window()));
    let stretch = [window.from_ns, window.to_ns].map(|at_ns| style::number(seconds(at_ns), 3)).join(" to ");
    let file = args.file.display();
    let first = if is_whole { "" } else { "first " };
    let about = format!("{stretch} s of {file}, {first}{} frames", style::number(frames as f64, 0));
    let title = args.title.clone().or_else(|| survey.link()).unwrap_or_else(|| file.to_string());
    let caption = chart::Caption { title, about, range: shown.range(), axis: "time (s)" };
    Ok((Sheet { panels, caption }, damage))
}

/// The options, and the result of reading the recording once: which slaves and times there are to draw. A second reading
/// makes the curves.
struct First {
    survey: Survey,
    asked: Asked,
    chosen: Chosen,
    device: Option<Address>,
    /// The range of times in which the network was in OP.
    op: Window,
    /// The times of the options `--from` and `--to`.
    times: Times,
    /// The number of frames that were read, and whether these are all.
    frames: u64,
    is_whole: bool,
    damage: Option<RecordError>,
}

impl First {
    /// The part of the time in OP that `--from` and `--to` select.
    fn window(&self) -> Result<Window, PlotError> {
        let nothing = || PlotError::NothingInRange { asked: self.times.to_string(), op: self.op.to_string() };
        self.op.cut(self.times).ok_or_else(nothing)
    }
}

/// Calls `check`, which checks the output file, then reads the recording for the first time, and prints notes on what is wrong
/// with the recording. The file is checked first, because a long recording takes time to read.
fn first(args: &Args, room: Room, check: impl FnOnce() -> Result<(), PlotError>) -> Result<First, CliError> {
    if args.file == Path::new("-") {
        return Err(PlotError::Stdin.into());
    }
    let asked = args.asked()?;
    if asked.slaves.len() > room.axes {
        return Err(PlotError::TooManyAxes { found: asked.slaves.len() }.into());
    }
    check()?;
    let mut survey = Survey::default();
    let device = recording::board(&args.file, args.device)?;
    let mut recording = args.open(device)?;
    let times = args.times.times();
    let until_ns = times.to.map_or(i64::MAX, |s| Window::of_times(0, nanoseconds(s)).read_until_ns());
    let mut walked = recording.walk(until_ns, |framed| survey.frame(framed))?;
    let is_part = !walked.is_whole || recording.part_of().is_some();
    if is_part && survey.op().is_none_or(|op| op.cut(times).is_none()) {
        // Nothing can be drawn, and the error names the time in OP, which the rest of the recording has.
        survey = Survey::default();
        recording = Frames::open(&args.file, args.slot_size, device)?.quiet();
        walked = recording.walk(i64::MAX, |framed| survey.frame(framed))?;
    }
    let Walked { frames, is_whole, damage, jumps } = walked;
    let (frames, is_whole) = recording.part_of().map_or((frames, is_whole), |frames| (frames, true));
    recording.note_zero();
    recording.note_missing();
    if let Some(jumps) = jumps {
        say("note", &format_args!("{}: {jumps}", args.file.display()));
    }
    let Some(op) = survey.op() else {
        let no_op = PlotError::NoOp { file: args.file.clone(), frames };
        return Err(damage.map_or(no_op.into(), CliError::from));
    };
    let chosen = asked.choose(&survey, room)?;
    Ok(First { survey, asked, chosen, device, op, times, frames, is_whole, damage })
}

impl Args {
    /// The path of the picture: that of `-o`, otherwise the recording's with the extension `.svg`.
    fn output(&self) -> PathBuf {
        self.output.clone().unwrap_or_else(|| self.file.with_extension("svg"))
    }

    /// Opens the recording: the part for the range of `--from` and `--to`, if either is given.
    fn open(&self, device: Option<Address>) -> Result<Frames<Box<dyn Read + Send>>, RecordError> {
        let times = self.times.times();
        if times.from.is_none() && times.to.is_none() {
            return Frames::open(&self.file, self.slot_size, device);
        }
        let from_ns = times.from.map_or(0, |s| nanoseconds(s).saturating_sub(READ_BEFORE_NS));
        let to_ns = times.to.map_or(i64::MAX, |s| Window::of_times(0, nanoseconds(s)).read_until_ns());
        Frames::open_part(&self.file, self.slot_size, device, (from_ns, to_ns))
    }

    fn asked(&self) -> Result<Asked, CliError> {
        let loaded = machine_option::of_recording(self.machine.as_deref(), recording::carried(&self.file).as_deref())?;
        let machine = loaded.as_ref();
        let named: Result<Vec<Vec<u8>>, _> = self.axes.iter().map(|word| word.slaves(machine)).collect();
        let mut slaves = named?.concat();
        slaves.sort_unstable();
        slaves.dedup();
        let plane = match &self.xy {
            Some([x, y]) => Some([x.slave("plot", machine)?, y.slave("plot", machine)?]),
            None => None,
        };
        if let Some([x, _]) = plane.filter(|[x, y]| x == y) {
            return Err(PlotError::SameAxis { axis: x }.into());
        }
        Ok(Asked { slaves, diagrams: self.panels.clone(), difference: self.difference, plane, machine: loaded })
    }

    /// How axes and units are named: by the options `--counts-per-unit` and `--unit`, else by the machine file.
    fn names<'m>(&self, axes: &[u8], machine: Option<&'m MachineFile>) -> layout::Names<'m> {
        if self.counts_per_unit.is_none() {
            return layout::Names::of_machine(axes, machine);
        }
        let unit = self.unit.as_deref().unwrap_or("units");
        layout::Names { unit: style::fitting(unit, style::TEXT, 100), machine, has_own_units: false }
    }

    /// Makes the panels, for which the recording is read a second time.
    fn panels(
        &self,
        mut recording: Frames<Box<dyn Read + Send>>,
        asked: &Asked,
        chosen: &Chosen,
        survey: &Survey,
        window: Window,
        other: Option<&Other>,
    ) -> Result<Vec<panel::Panel>, CliError> {
        let machine = asked.machine.as_ref();
        let of_machine =
            |axis| machine.and_then(|machine| machine.axis_of(axis)).map_or(Scale::COUNTS, |axis| axis.scale);
        let scale = |axis| self.counts_per_unit.as_ref().map_or_else(|| of_machine(axis), |scales| scales.of(axis));
        let axes: Vec<(u8, Scale)> = chosen.axes.iter().map(|axis| (*axis, scale(*axis))).collect();
        let mut series = Series::new(&Subject {
            window,
            columns: COLUMNS,
            axes: &axes,
            ios: &chosen.ios,
            plane: chosen.plane,
            board: survey.board(),
            cycle_ns: survey.cycle_ns(),
            commands: self.commands.iter().map(|command| command.code()).collect(),
        });
        recording.walk(window.read_until_ns(), |framed| series.frame(framed))?;
        let lines = series.finish();
        if !self.commands.is_empty() && lines.is_empty() {
            let names = self.commands.iter().map(|command| CommandId::from_code(command.code()).to_string());
            let commands = names.collect::<Vec<_>>().join(", ");
            let axes = chosen.axes.iter().chain(&chosen.ios).copied().collect();
            return Err(PlotError::NoSuchCommand { commands, axes }.into());
        }
        let beside = other.map(|other| other.lines(&axes)).transpose()?;
        let names = self.names(&chosen.axes, machine);
        let panels = layout::panels(lines, asked, chosen.plane, &names, beside.unwrap_or_default());
        if panels.is_empty() {
            let names = asked.diagrams.iter().filter_map(ValueEnum::to_possible_value);
            let asked = names.map(|name| name.get_name().to_owned()).collect::<Vec<_>>().join(", ");
            return Err(PlotError::NoPanel { asked }.into());
        }
        Ok(panels)
    }
}

/// A range of times of frames, both ends included, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    from_ns: i64,
    to_ns: i64,
}

impl Window {
    /// The range from `from_ns` to `to_ns`.
    pub const fn of_times(from_ns: i64, to_ns: i64) -> Self {
        Self { from_ns, to_ns }
    }

    /// A range of command numbers instead of times: from command 1 to command `count`.
    pub const fn of_commands(count: u64) -> Self {
        Self { from_ns: command_place(1), to_ns: command_place(if count == 0 { 1 } else { count }) }
    }

    /// The time up to which a recording is read to draw this range. \[OURS] It is one second later than the range. In state
    /// 0x18 (OP with a lost slave) only a slot that no longer changes shows which slave is lost. The slot of a moving slave
    /// that is not lost changes within that second.
    const fn read_until_ns(self) -> i64 {
        self.to_ns.saturating_add(1_000_000_000)
    }

    /// The range of the horizontal axis, in seconds. A range of a single moment is extended on both sides.
    pub fn range(self) -> std::ops::Range<f64> {
        let (from, to) = (seconds(self.from_ns), seconds(self.to_ns));
        panel::distinct(if to > from { from..to } else { from - 0.001..to + 0.001 })
    }

    const fn contains(self, at_ns: i64) -> bool {
        self.from_ns <= at_ns && at_ns <= self.to_ns
    }

    /// The smallest range that contains both ranges.
    fn with(self, other: Self) -> Self {
        Self { from_ns: self.from_ns.min(other.from_ns), to_ns: self.to_ns.max(other.to_ns) }
    }

    /// The part within `times`; `None` if nothing is left.
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

/// The horizontal position of command `n` in a range of [`Window::of_commands`], which takes the place of nanoseconds.
pub const fn command_place(n: u64) -> i64 {
    (n as i64).saturating_mul(1_000_000_000)
}

/// Converts nanoseconds to seconds.
pub fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}

#[cfg(test)]
mod tests;
