//! `ecmsk recording export`: writes a recording in another format, or its reports as a table.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use clap::ValueHint;
use ecmsk::link::record::{RecordingCopy, check_room};
use ecmsk::recording::{Address, Lacks, RecordError, RecordMeta};
use ecmsk::sk::SlotSize;

use super::super::board::BoardError;
use super::super::error::CliError;
use super::super::filter::{TimeOptions, Times, nanoseconds};
use super::super::output_file::{Kind, OutputFile, Replace};
use super::super::recording::{self, Framed, Frames, Walked};
use super::super::stderr::say;
use super::super::{output, signals, slot_size};
use super::RecordingVerbError;
use super::arrow_file::ArrowFile;
use super::csv_file::CsvFile;
use super::mcap_file::McapFile;
use super::table::{Format, Table, TableError};

/// How long after `--to` a copy still reads frames, ns. A report that was read late is in the file after commands that
/// were sent later than it. \[OURS]
const LATE_NS: i64 = 1_000_000_000;

/// A function that begins a table in a file.
type NewTable = fn(File) -> io::Result<Box<dyn Format>>;

/// The formats of output files by their endings; `None`: a recording.
const FORMATS: [(&str, Option<NewTable>); 6] = [
    ("pcapng", None),
    ("ecmrec", None),
    ("csv", Some(|file| Ok(Box::new(CsvFile::new(file))))),
    ("mcap", Some(|file| Ok(Box::new(McapFile::new(file)?)))),
    ("arrow", Some(new_arrow)),
    ("feather", Some(new_arrow)),
];

fn new_arrow(file: File) -> io::Result<Box<dyn Format>> {
    Ok(Box::new(ArrowFile::new(file)))
}

/// The endings of [`FORMATS`] for a message: `.pcapng, .csv or .mcap`.
pub(super) fn endings() -> String {
    let names = FORMATS.map(|(ending, _)| format!(".{ending}"));
    let (last, others) = names.split_last().expect("there are formats");
    format!("{} or {last}", others.join(", "))
}

/// Write a recording in another format: pcapng for Wireshark, .ecmrec, or a table as CSV, MCAP or Arrow
///
/// The ending of OUT names the format: .pcapng, .ecmrec, .csv, .mcap (Foxglove, PlotJuggler), .arrow or .feather (pandas,
/// Polars). A table has a row for each report in OP: its time, what it says of the board, and for each slave its position,
/// statusword, torque and error code, or its inputs, and the target that was sent last. Its columns are those of the slaves in
/// the first of these reports. Memory does not grow with the length of the recording.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk recording export run.ecmrec run.pcapng
  ecmsk recording export day.ecmrec moment.mcap --from 3600 --to 3620")]
pub struct Args {
    /// The recording; for a table also a capture
    #[arg(value_name = "IN", value_hint = ValueHint::FilePath)]
    input: PathBuf,

    /// The file to write: .pcapng, .ecmrec, .csv, .mcap, .arrow or .feather
    #[arg(value_name = "OUT", value_hint = ValueHint::FilePath)]
    output: PathBuf,

    /// Replace an output file that exists
    #[arg(long)]
    overwrite: bool,

    #[command(flatten)]
    times: TimeOptions,

    /// In a table, only the slaves with these numbers; comma list [default: all that the first report in OP has]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = clap::value_parser!(u8).range(1..=40))]
    axes: Vec<u8>,

    /// Bytes of a slot, 12 or 16 [default: from the recording, else from its CRCs]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// In a capture with several boards, use the one at BUS.DEVICE
    #[arg(long, value_name = "BUS.DEVICE", value_parser = recording::parse_device)]
    device: Option<Address>,
}

/// Runs `ecmsk recording export`.
///
/// [`CliError`] if the recording cannot be read, if it has no report in OP (for a table) or no frame (for a copy), or
/// if a copy of a capture of another program is requested. Also if the output file has another extension or cannot be
/// written, if a signal arrives, or if standard output cannot be written to. The output file is not changed then.
pub fn run(args: &Args) -> Result<(), CliError> {
    let (input, output) = (&args.input, &args.output);
    if recording::is_same_file(input, output) {
        return Err(RecordingVerbError::SameFile { file: output.clone() }.into());
    }
    let ending = output.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let Some((_, format)) = FORMATS.into_iter().find(|(known, _)| *known == ending) else {
        return Err(RecordingVerbError::Ending { file: output.clone() }.into());
    };
    args.output_file().check().map_err(RecordingVerbError::from)?;
    let device = recording::board(input, args.device)?;
    let mut frames = args.open(device)?;
    let (count, walked) = match format {
        None => copy(args, &mut frames)?,
        Some(format) => table(args, &mut frames, format)?,
    };
    frames.note_walked(&walked);
    Ok(output::print(format!("{}: {count}\n", output.display()))?)
}

impl Args {
    fn output_file(&self) -> OutputFile<'_> {
        OutputFile { file: &self.output, option: "", kind: Kind::Any, replace: Replace::Asked(self.overwrite) }
    }

    /// Opens the recording. With `--from` or `--to`, only the requested part is read.
    fn open(&self, device: Option<Address>) -> Result<Frames<Box<dyn Read + Send>>, RecordError> {
        let times = self.times.times();
        if times == Times::default() {
            return Frames::open(&self.input, self.slot_size, device);
        }
        Frames::open_part(&self.input, self.slot_size, device, (times.from.map_or(0, nanoseconds), until_ns(times)))
    }
}

/// The end of the times, in ns since the first frame.
fn until_ns(times: Times) -> i64 {
    times.to.map_or(i64::MAX, nanoseconds)
}

/// Copies the frames to a recording of another format. Returns the number of frames as text for the user, e.g. `12
/// frames`.
fn copy(args: &Args, frames: &mut Frames<Box<dyn Read + Send>>) -> Result<(String, Walked), CliError> {
    let failed = |source| RecordingVerbError::Write { file: args.output.clone(), source };
    let times = args.times.times();
    // A recording may replace only recordings of ecmsk, as with `--record`.
    let (output, stop) = (args.output_file(), Stop::watch()?);
    check_room(&args.output, args.overwrite).map_err(|error| RecordingVerbError::from(output.failed(error)))?;
    let new = output.begin().map_err(RecordingVerbError::from)?;
    let mut progress = Progress::new(&args.input);
    let mut copy: Option<(Arc<RecordMeta>, RecordingCopy)> = None;
    let mut count = 0_u64;
    let order = frames.in_time().unsorted();
    let walked = frames.try_walk(order, until_ns(times).saturating_add(LATE_NS), |framed| {
        progress.frame(framed);
        stop.check()?;
        let Some(meta) = framed.meta.clone() else {
            return Err(CliError::from(RecordingVerbError::Capture { file: args.input.clone() }));
        };
        // Each opening of the board has its own metadata, and becomes a separate recording in the output file.
        if let Some((_, ended)) = copy.take_if(|(of, _)| *of != meta) {
            ended.end(&Lacks::default()).map_err(failed)?;
        }
        let (_, writer) = copy.get_or_insert_with(|| (Arc::clone(&meta), RecordingCopy::new(new.path(), &meta)));
        if times.contains(framed.time_ns) {
            writer.add(&framed.recorded).map_err(failed)?;
            count += 1;
        } else {
            writer.look(&framed.recorded);
        }
        Ok(true)
    })?;
    if let Some((_, last)) = copy {
        let mut lacks = inherited(frames.lacks().unwrap_or_default());
        if walked.damage.is_some() {
            lacks.not_ended = lacks.not_ended.max(1);
        }
        last.end(&lacks).map_err(failed)?;
    }
    match count {
        0 => Err(RecordingVerbError::NoFrame { file: args.input.clone(), times }.into()),
        count => {
            new.finish().map_err(RecordingVerbError::from)?;
            Ok((format!("{count} frames"), walked))
        }
    }
}

/// What the output file lacks if the input file lacks `lacks`. Damaged sections of the input are not copied, so their
/// frames count as missing in the output.
fn inherited(mut lacks: Lacks) -> Lacks {
    if lacks.damage.count > 0 {
        lacks.missing += lacks.damage.whole.packets.max(1);
        lacks.why = Some("they were damaged in the file that was copied".to_owned());
    }
    lacks
}

/// Writes a table with a row for each report in OP. Returns the number of rows as text for the user, e.g. `12 rows`.
fn table(
    args: &Args,
    frames: &mut Frames<Box<dyn Read + Send>>,
    format: NewTable,
) -> Result<(String, Walked), CliError> {
    let failed = |source| RecordingVerbError::Write { file: args.output.clone(), source };
    let times = args.times.times();
    let (output, stop) = (args.output_file(), Stop::watch()?);
    let mut new = output.begin().map_err(RecordingVerbError::from)?;
    let mut progress = Progress::new(&args.input);
    let file = new.file().map_err(failed)?;
    let mut table = Table::new(format(file).map_err(failed)?, args.axes.clone(), times);
    let walked = frames.walk_while(until_ns(times), |framed| {
        progress.frame(framed);
        stop.check()?;
        table.frame(framed).map_err(|error| match error {
            TableError::Write(source) => failed(source),
            TableError::NoAxis { axis, axes } => RecordingVerbError::NoAxis { file: args.input.clone(), axis, axes },
        })?;
        Ok::<_, CliError>(true)
    })?;
    let rows = table.finish(frames.lacks_with(&walked)).map_err(failed)?;
    if rows == 0 {
        return Err(RecordingVerbError::NoRow { file: args.input.clone(), times }.into());
    }
    new.finish().map_err(RecordingVerbError::from)?;
    Ok((format!("{rows} rows"), walked))
}

/// Catches signals such as Ctrl-C. After a signal the export fails, and the unfinished output file is removed.
struct Stop(Arc<AtomicUsize>);

impl Stop {
    fn watch() -> Result<Self, BoardError> {
        let signal = Arc::default();
        signals::note(&signal).map_err(BoardError::system("catch signals"))?;
        Ok(Self(signal))
    }

    fn check(&self) -> Result<(), BoardError> {
        match u8::try_from(self.0.load(Ordering::Relaxed)) {
            Ok(0) | Err(_) => Ok(()),
            Ok(signal) => Err(BoardError::Stopped { signal, next: "no file was written".to_owned() }),
        }
    }
}

/// Prints every few seconds how much of a long recording was read.
pub struct Progress<'a> {
    file: &'a Path,
    said: Instant,
    frames: u64,
}

impl<'a> Progress<'a> {
    /// The shortest time between two progress messages. \[OURS]
    const EVERY: Duration = Duration::from_secs(5);
    /// The clock is read only once per this number of frames, since reading it for every frame would be slow.
    const FRAMES: u64 = 4096;

    /// Starts the time until the first progress message. `file` is the recording that is read.
    pub fn new(file: &'a Path) -> Self {
        Self { file, said: Instant::now(), frames: 0 }
    }

    /// Counts a frame that was read, and prints a progress message if one is due.
    pub fn frame(&mut self, framed: &Framed) {
        self.frames += 1;
        if self.frames.is_multiple_of(Self::FRAMES) && self.said.elapsed() >= Self::EVERY {
            self.said = Instant::now();
            let (file, frames, seconds) = (self.file.display(), self.frames, framed.time_ns as f64 / 1e9);
            say("progress", &format_args!("{file}: {frames} frames, up to {seconds:.0} s"));
        }
    }
}
