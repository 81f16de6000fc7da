//! `ecmsk monitor`: a live table of all slaves. It only reads, so it does not disturb other programs.
//!
//! Files:
//!
//! - `source.rs`: the source of reports: a board or a recording
//! - `watched.rs`: the state of the board, collected from its frames, and a view of it
//! - `rows.rs`, `screen.rs`: the table as rows, and how it is drawn
//! - `terminal.rs`: keys, signals, and the restoring of the terminal
//! - `json.rs`: a view as JSON

pub mod json;
mod rows;
mod screen;
pub mod source;
mod terminal;
mod watched;

use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use clap::ValueHint;
use ecmsk::ecm::EcmError;
use ecmsk::engine::Firmware;
use ecmsk::link::options::SimOptions;
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{KnownNetwork, LinkError};
use ecmsk::machine_file::{MachineFile, MachineFileError};
use ecmsk::recording::RecordError;
use ecmsk::sk::{SlaveKind, SlotSize};

use super::error::CliError;
use super::kind_list::KindList;
use super::link_option::{ChoiceError, ChosenLink, Unnamed, as_reader};
use super::recording::{self, Frames};
use super::stderr::say;
use super::{machine_option, output, recording_end, slot_size};
use source::{Around, Each, Feed};
use watched::{View, Watched};

/// Show a board and all its slaves live: states, positions, inputs, alarms, FIFO and counters
///
/// Nothing is ever sent to the board: on `tcp:` the monitor is one of the readers, beside the program that moves the
/// axes. A simulated board (`sim:`) belongs to this process alone, so that nothing moves on it.
///
/// Keys: arrows, page up and down, home and end scroll; q or Ctrl-C ends.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk monitor --link tcp://192.168.1.20:4711
  ecmsk monitor --once
  ecmsk monitor --recording run.pcapng
  ecmsk monitor --json --interval 1s | jq '.slots[0].fifo_free_entries'")]
pub struct Args {
    /// Board to show, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or ecmsk.toml, else usb:]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    /// Show a recording instead, at its original speed
    #[arg(long, value_name = "FILE", conflicts_with = "link", value_hint = ValueHint::FilePath)]
    recording: Option<PathBuf>,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    #[arg(long, value_name = "LIST", value_parser = KindList::parse, help = KindList::help(
        "The slaves in the order of the network",
        " [default: those of the machine file, of a sim: link, or as a server or a recording tells, else guessed from what they say]",
    ))]
    slaves: Option<KindList>,

    /// Bytes of a slot, 12 or 16 [default: from the link, else from the CRCs]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// Former name of --slot-size
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse, hide = true, conflicts_with = "slot_size")]
    slot: Option<SlotSize>,

    /// Print the table once and end; for a recording, the table at its end
    #[arg(long)]
    once: bool,

    /// Print one JSON object each interval, each on a line of its own
    #[arg(long)]
    json: bool,

    /// Interval of updates, e.g. 100ms
    #[arg(long, value_name = "TIME", default_value = "100ms", value_parser = interval)]
    interval: Duration,

    /// End after so many seconds
    #[arg(long, value_name = "N", value_parser = seconds)]
    seconds: Option<Duration>,
}

/// Why the monitor cannot show a board or a recording.
#[derive(Debug, thiserror::Error)]
pub enum MonitorError {
    /// `ECMSK_LINK` or a configuration file with the link is invalid.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
    /// The machine file cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineFileError),
    /// No link is named, and the default link does not open.
    #[error(transparent)]
    Unnamed(#[from] Unnamed),
    /// The board cannot be opened, or was lost.
    #[error(transparent)]
    Board(#[from] EcmError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// The recording has no report.
    #[error("{} holds no report; record a program that reads", .file.display())]
    NoReport {
        /// The path of the recording.
        file: PathBuf,
    },
    /// Standard output is no terminal.
    #[error("standard output is no terminal; for other places use --once or --json")]
    NoTerminal,
    /// Drawing on the terminal or reading its keys failed.
    #[error("the terminal: {0}; for other places use --once or --json")]
    Terminal(io::Error),
    /// The operating system refuses to start a thread.
    #[error("cannot start a thread: {0}; free some of the system's memory or threads, then run it again")]
    Thread(io::Error),
}

impl From<LinkError> for MonitorError {
    fn from(error: LinkError) -> Self {
        Self::Board(error.into())
    }
}

impl Args {
    /// The slot size that `--slot-size`, or its former name `--slot`, gives; `None` if neither is there.
    fn size(&self) -> Option<SlotSize> {
        slot_size::given(self.slot_size, self.slot)
    }
}

/// Runs the monitor. The exit code also says whether its recording is complete.
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let given = args.machine.as_deref();
    let machine = match &args.recording {
        Some(file) => machine_option::of_recording(given, recording::carried(file).as_deref()),
        None => machine_option::of_link(given, args.link.as_ref()),
    };
    let machine = machine.map_err(MonitorError::from)?.map(Arc::new);
    let code = show(args, machine.as_ref())?;
    if code != ExitCode::SUCCESS || args.recording.is_some() {
        return Ok(code);
    }
    let link = ChosenLink::find_with(args.link.as_ref(), machine.as_deref()).map_err(MonitorError::from)?.uri;
    Ok(recording_end::not_whole(Some(&link)).map_or(code, |lacks| {
        say("warning", &lacks);
        ExitCode::from(recording_end::NOT_WHOLE)
    }))
}

fn show(args: &Args, machine: Option<&Arc<MachineFile>>) -> Result<ExitCode, CliError> {
    if args.once || args.json {
        return match &args.recording {
            Some(file) => replay(args, file, machine),
            None => look(args, machine),
        };
    }
    if let Some(file) = &args.recording {
        // The recording is opened here only so that an error in it comes before the error that standard output is no terminal.
        drop(Frames::open(file, args.size(), None)?);
    }
    if !io::stdout().is_terminal() {
        return Err(MonitorError::NoTerminal.into());
    }
    let feed = feed(args, machine)?;
    let code = terminal::run(&feed, args.interval, args.seconds)?;
    Ok(code)
}

/// Shows a board in every interval.
fn look(args: &Args, machine: Option<&Arc<MachineFile>>) -> Result<ExitCode, CliError> {
    let feed = feed(args, machine)?;
    // The first view is dropped, since rates are relative to the view before.
    drop(feed.view());
    let began = Instant::now();
    let mut next = began;
    loop {
        // After a late view, the interval to the next one is not shortened.
        next = (next + args.interval).max(Instant::now());
        thread::sleep(next.saturating_duration_since(Instant::now()));
        let (view, end) = feed.view();
        if let Some(error) = end {
            return Err(error.into());
        }
        print(args, &view)?;
        if args.once || args.seconds.is_some_and(|seconds| began.elapsed() >= seconds) {
            return Ok(ExitCode::SUCCESS);
        }
    }
}

/// Shows a recording in every interval of its own time.
fn replay(args: &Args, file: &Path, machine: Option<&Arc<MachineFile>>) -> Result<ExitCode, CliError> {
    let mut watched = recorded(args, file, machine);
    let interval_ns = i64::try_from(args.interval.as_nanos()).unwrap_or(i64::MAX);
    let last_ns = args.seconds.map(|seconds| i64::try_from(seconds.as_nanos()).unwrap_or(i64::MAX));
    let (mut first_ns, mut next_ns) = (None, None);
    let mut seen = false;
    let walked = source::walk(file, args.size(), |framed| {
        let at_ns = framed.time_ns;
        let since_ns = at_ns.saturating_sub(*first_ns.get_or_insert(at_ns));
        if last_ns.is_some_and(|last| since_ns > last) {
            return Ok(false);
        }
        let due = *next_ns.get_or_insert(at_ns.saturating_add(interval_ns));
        if at_ns > due {
            let passed = (at_ns - due - 1) / interval_ns + 1;
            next_ns = Some(due.saturating_add(passed.saturating_mul(interval_ns)));
            let view = watched.view();
            if args.json && view.board.is_some() {
                print(args, &view)?;
            }
        }
        source::take(&mut watched, framed);
        seen |= framed.recorded.dir == ecmsk::link::Dir::Read;
        Ok(true)
    })?;
    if !seen {
        return Err(MonitorError::NoReport { file: file.to_owned() }.into());
    }
    if let Some(damage) = walked {
        say("note", &damage);
        watched.end = Some(damage);
    }
    print(args, &watched.view())?;
    Ok(ExitCode::SUCCESS)
}

fn print(args: &Args, view: &View) -> Result<(), CliError> {
    let text = if args.json { json::line(view) } else { screen::text(view) };
    Ok(output::print(text)?)
}

/// The state of a recording's board before its first frame: the name, the kinds of the slaves, the machine file.
fn recorded(args: &Args, file: &Path, machine: Option<&Arc<MachineFile>>) -> Watched {
    let kinds = kinds(args.slaves.as_ref(), None, machine.map(Arc::as_ref));
    let mut watched = Watched::new(file.display().to_string(), kinds.as_deref());
    watched.machine = machine.cloned();
    watched
}

fn feed(args: &Args, machine: Option<&Arc<MachineFile>>) -> Result<Feed, MonitorError> {
    if let Some(file) = &args.recording {
        return Feed::recording(file.clone(), args.size(), recorded(args, file, machine));
    }
    let chosen = ChosenLink::find_with(args.link.as_ref(), machine.map(Arc::as_ref))?;
    board(&chosen, args.slaves.as_ref(), args.size(), machine, Box::new(|link| link), Box::new(|_, _, _| {}))
}

/// Watches a board. `around` may wrap its link; `each` is called with each report.
///
/// # Errors
/// [`MonitorError`] if the link does not open, if the board sends no report, or if no thread can be started.
pub fn board(
    chosen: &ChosenLink,
    slaves: Option<&KindList>,
    size: Option<SlotSize>,
    machine: Option<&Arc<MachineFile>>,
    around: Around,
    each: Each,
) -> Result<Feed, MonitorError> {
    if let Some(machine) = machine {
        machine_option::note_differences(machine, &chosen.uri);
    }
    let uri = as_reader(&chosen.uri);
    let watched = |known: Option<KnownNetwork>| {
        let kinds = known_kinds(slaves, &uri, machine.map(Arc::as_ref), known);
        let mut watched = Watched::new(uri.to_string(), kinds.as_deref());
        watched.machine = machine.cloned();
        if uri.value("fw") == Some("1.5") {
            watched.firmware = Firmware::V15;
        }
        watched
    };
    Feed::board(&uri, size, around, each, watched).map_err(|error| match &error {
        MonitorError::Board(EcmError::Link(link)) => chosen.if_unnamed(link).map_or(error, MonitorError::from),
        _ => error,
    })
}

/// The kinds of the slaves of a board: from the options, the machine file or the link, else those that the server
/// reports.
pub fn known_kinds(
    slaves: Option<&KindList>,
    uri: &LinkUri,
    machine: Option<&MachineFile>,
    known: Option<KnownNetwork>,
) -> Option<Vec<SlaveKind>> {
    let told = || Some(KindList::parse(&known?.slaves).ok()?.kinds().to_vec());
    kinds(slaves, Some(uri), machine).or_else(told)
}

/// The kinds of the slaves from the options, the machine file or the link; `None` if none of these gives them.
fn kinds(slaves: Option<&KindList>, uri: Option<&LinkUri>, machine: Option<&MachineFile>) -> Option<Vec<SlaveKind>> {
    if let Some(list) = slaves {
        return Some(list.kinds().to_vec());
    }
    if let Some(machine) = machine {
        return Some(machine.slaves.iter().map(|slave| slave.kind).collect());
    }
    let uri = uri.filter(|uri| uri.scheme().is_model())?;
    Some(SimOptions::from_uri(uri).ok()?.slaves.into_iter().map(|slave| slave.model.kind()).collect())
}

/// The shortest interval of updates, in seconds. Nobody sees shorter changes. \[OURS]
const INTERVAL_MIN_S: f64 = 0.01;

fn interval(text: &str) -> Result<Duration, String> {
    let seconds = super::filter::parse_seconds(text)?;
    let interval = Duration::try_from_secs_f64(seconds).ok().filter(|_| (INTERVAL_MIN_S..=3600.0).contains(&seconds));
    interval.ok_or_else(|| "allowed: 10ms to 3600s".to_owned())
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = super::filter::parse_seconds(text)?;
    Duration::try_from_secs_f64(seconds).map_err(|_| "allowed: 0 and more seconds".to_owned())
}
