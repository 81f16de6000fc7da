//! The HTML page of a recording: a single file that a browser opens from disk. It shows the same curves as the
//! pictures, but of all slaves and in full resolution, and the events of the run. The source of the page is in
//! `tool/web/`.

use std::path::{Path, PathBuf};

use data_encoding::BASE64;
use ecmsk::compare::Deviation;
use ecmsk::ecm::{Scale, Scales};
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::Kinds;
use ecmsk::sk::SlotSize;
use ecmsk::sk::dump::MAX_SLAVES;

use super::beside::{Beside, Other};
use super::decimate::Pieces;
use super::lanes::Way;
use super::series::{Lines, Series, Subject};
use super::states::{self, State};
use super::{Args, First, PlotError, Room, Window, file, first};
use crate::compare;
use crate::error::CliError;
use crate::filter::TimeOptions;
use crate::find::Search;
use crate::output;
use crate::output_file::{Kind, OutputFile, OverwriteOption};
use crate::stderr::say;
use crate::web::assembly::{Page, page};
use crate::web::channels::{Channels, Key, Quantity};
use crate::web::codec;
use crate::web::events::{Event, EventKind, Events, Span};
use crate::web::hello::{self, FORMAT, Hello, Names, Words};
use crate::web::sampler::Sampler;

/// The number of columns to which a curve of the page is thinned. A minute at 1 kHz keeps every sample. \[OURS]
const COLUMNS: u32 = 200_000;

/// The largest number of times of `--find` among the events, so that they leave room for others. \[OURS]
const FOUND_MAX: usize = 1000;

/// The page shows up to this many slaves: all slaves of the network.
const ROOM: Room = Room { axes: MAX_SLAVES, slaves: MAX_SLAVES };

/// Whether the output file is a page: its name ends in `.html`.
pub fn is_asked(output: &Path) -> bool {
    output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("html"))
}

/// Writes the page to its file and prints the path of the file.
pub fn run(args: &Args, output: &Path) -> Result<(), CliError> {
    let file = OutputFile { file: output, option: "-o", kind: Kind::Page, replace: args.overwrite.replace() };
    if !args.panels.is_empty() || args.difference {
        say("note", &"a page has all diagrams: --panels and --difference are for pictures");
    }
    let recordings: Vec<&Path> = [Some(&*args.file), args.beside.as_deref()].into_iter().flatten().collect();
    let page = of_recording(args, || file::check_other(&file, &recordings), None)?;
    file.write(page.html.as_bytes()).map_err(PlotError::from)?;
    Ok(output::print(format!("{}\n", output.display()))?)
}

impl Args {
    /// The arguments of `ecmsk plot FILE` that make the page served by `ecmsk serve web FILE`: the whole recording, all
    /// axes, no title.
    pub fn of_file(
        file: &Path,
        machine: Option<PathBuf>,
        slot_size: Option<SlotSize>,
        counts_per_unit: Option<Scales>,
        find: Option<String>,
    ) -> Self {
        Self {
            file: file.to_owned(),
            output: None,
            overwrite: OverwriteOption::default(),
            title: None,
            axes: Vec::new(),
            commands: Vec::new(),
            times: TimeOptions::default(),
            difference: false,
            beside: None,
            xy: None,
            panels: Vec::new(),
            find,
            counts_per_unit,
            machine,
            unit: None,
            slot_size,
            device: None,
        }
    }
}

/// Makes the page of a recording. `check` is called before the recording is read, so that an unusable output file is
/// reported at once. `connect` is as for [`page`].
///
/// # Errors
/// [`CliError`] if `check` fails, if the recording cannot be read or has no OP phase, if an option names an axis or a time
/// that the recording does not have, or if the page cannot be made.
pub fn of_recording(
    args: &Args,
    check: impl FnOnce() -> Result<(), PlotError>,
    connect: Option<&str>,
) -> Result<Page, CliError> {
    let first = first(args, ROOM, check)?;
    let window = first.window()?;
    let machine = first.asked.machine.as_ref();
    let names = Names { machine, scales: args.counts_per_unit.as_ref(), unit: args.unit.as_deref().unwrap_or("units") };
    let search = args.find.as_deref().map(|find| Search::parse(find, machine)).transpose().map_err(PlotError::from)?;
    let Read { lines, mut channels, mut events, found } = read(args, &first, window, (machine, &names), search)?;
    let mut block = channels.take_block();
    put(&mut block, &mut channels, &names, &lines);
    let mut notes: Vec<String> = first.damage.iter().map(ToString::to_string).collect();
    if let Some(other) = &args.beside {
        let beside = beside(args, &first, other, &mut notes)?;
        for (axis, pieces) in &beside.positions {
            put_curve(&mut block, &mut channels, &names, (*axis, Quantity::Beside, 0), pieces);
        }
        match first_difference(args, other) {
            Ok(Some(event)) => events.with([event]),
            Ok(None) => notes.push("no difference between them".to_owned()),
            Err(why) => notes.push(why),
        }
    }
    let spans = spans(&lines);
    let more = found.len().saturating_sub(FOUND_MAX);
    let of_find =
        found.iter().take(FOUND_MAX).zip(args.find.iter().cycle()).map(|(at_ns, find)| Event::found(*at_ns, find));
    events.with(of_spans(&spans).into_iter().chain(of_find));
    if more > 0 {
        notes.push(format!("{more} more times of --find are left out; `ecmsk find` prints all"));
    }
    if events.left_out() > 0 {
        notes.push(format!("{} earlier events are left out", events.left_out()));
    }
    let title = args.title.clone().or_else(|| first.survey.link()).unwrap_or_else(|| args.file.display().to_string());
    let hello = Hello {
        format: FORMAT,
        version: env!("CARGO_PKG_VERSION"),
        source: "recording",
        name: title.clone(),
        notes,
        slaves: hello::slaves(events.kinds(), &names),
        words: Words::new(),
        channels: channels.list(),
        events: events.found(),
        spans,
        plane: first.chosen.plane,
        picture: hello::Picture::of(machine),
        find: args.find.as_deref(),
        block: BASE64.encode(&block),
    };
    first.damage.iter().for_each(|damage| say("note", damage));
    let drawn = |error: serde_json::Error| PlotError::Draw { reason: error.to_string() };
    Ok(page(&title, Some(&hello), connect).map_err(drawn)?)
}

/// The result of the second reading of the recording: the curves of positions, targets and the like, the channels of
/// all other values, and the events.
struct Read {
    lines: Lines,
    channels: Channels,
    events: Events,
    /// The times at which the condition of `--find` became true.
    found: Vec<i64>,
}

fn read(
    args: &Args,
    first: &First,
    window: Window,
    (machine, names): (Option<&MachineFile>, &Names),
    mut search: Option<Search>,
) -> Result<Read, CliError> {
    let axes: Vec<(u8, Scale)> = first.chosen.axes.iter().map(|axis| (*axis, Scale::COUNTS)).collect();
    let mut series = Series::new(&Subject {
        window,
        columns: COLUMNS,
        axes: &axes,
        ios: &first.chosen.ios,
        plane: None,
        board: first.survey.board(),
        cycle_ns: first.survey.cycle_ns(),
        commands: args.commands.iter().map(|command| command.code()).collect(),
    });
    let size = first.survey.size();
    let mut events = Events::new(size, Kinds::new(None));
    let (mut sampler, mut channels) = (Sampler::new(false), Channels::default());
    let mut frames = args.open(first.device)?.quiet();
    frames.walk(window.read_until_ns(), |framed| {
        series.frame(framed);
        if first.survey.board().is_some_and(|board| board != framed.board()) {
            return;
        }
        let (at_ns, frame) = (framed.time_ns, &framed.recorded.frame);
        events.frame(at_ns, framed.recorded.dir, frame, machine);
        search.iter_mut().for_each(|search| search.frame(framed, window.contains(at_ns)));
        if framed.recorded.dir == ecmsk::link::Dir::Read && window.contains(at_ns) {
            sampler.report(&mut channels, names, at_ns, (frame, size), events.kinds());
        }
    })?;
    let found = search.map(Search::finish).unwrap_or_default().iter().map(|span| span.from_ns).collect();
    Ok(Read { lines: series.finish(), channels, events, found })
}

/// Appends the curves of the plot to `block`, the page's data block. Each curve becomes a channel of the page, and each
/// of its uninterrupted pieces becomes one record of the block.
fn put(block: &mut Vec<u8>, channels: &mut Channels, names: &Names, lines: &Lines) {
    let mut put = |slave, quantity: Quantity, bit, pieces: &Pieces| {
        put_curve(block, channels, names, (slave, quantity, bit), pieces);
    };
    put(0, Quantity::FifoFree, 0, &lines.fifo_free);
    for axis in &lines.axes {
        let curves = [
            (Quantity::Position, &axis.position),
            (Quantity::Target, &axis.target),
            (Quantity::FollowingError, &axis.difference),
            (Quantity::Velocity, &axis.velocity),
            (Quantity::TargetVelocity, &axis.commanded_velocity),
            (Quantity::Csv, &axis.target_velocity),
            (Quantity::Torque, &axis.torque),
            (Quantity::Cst, &axis.target_torque),
        ];
        curves.into_iter().for_each(|(quantity, pieces)| put(axis.axis, quantity, 0, pieces));
    }
    for (slave, lanes) in &lines.ios {
        for lane in lanes {
            let quantity = if lane.way == Way::In { Quantity::Input } else { Quantity::Output };
            put(*slave, quantity, lane.bit as u8, &lane.values);
        }
    }
}

fn put_curve(block: &mut Vec<u8>, channels: &mut Channels, names: &Names, key: Key, pieces: &Pieces) {
    if pieces.is_empty() {
        return;
    }
    let channel = channels.place(key, names);
    for piece in pieces {
        let point = |(s, value): &(f64, f64)| ((s * 1e9).round() as i64, (value / key.1.step()).round() as i64);
        codec::append(block, channel, true, &piece.iter().map(point).collect::<Vec<_>>());
    }
}

/// The curves of the recording of `--beside`. Adds notes about it.
fn beside(args: &Args, first: &First, file: &Path, notes: &mut Vec<String>) -> Result<Beside, CliError> {
    let other = Other::read(file, args.slot_size, first.op)?;
    if let Some(damage) = other.damage() {
        say("note", damage);
        notes.push(damage.to_string());
    }
    let axes: Vec<(u8, Scale)> = first.chosen.axes.iter().map(|axis| (*axis, Scale::COUNTS)).collect();
    let beside = other.cut(first.times).map(|other| other.lines(&axes)).transpose()?.unwrap_or_default();
    let what = if beside.positions.is_empty() { "not in the time shown" } else { "dotted" };
    notes.push(format!("positions of {}: {what}", file.display()));
    Ok(beside)
}

/// The first difference from the recording of `--beside`, in the words of `ecmsk compare`; none if they are equal.
///
/// # Errors
/// Why they cannot be compared.
fn first_difference(args: &Args, other: &Path) -> Result<Option<Event>, String> {
    let found = compare::first_difference([&args.file, other], args.slot_size)
        .map_err(|error| format!("not compared: {error}"))?;
    Ok(found.map(|(difference, settles)| {
        let slave = difference.what.first().and_then(Deviation::slave).unwrap_or_default();
        let settles = settles.map(|counts| format!("; positions alone differ, by no more than {counts} counts"));
        let text = format!("first difference (B is {}), {difference}{}", other.display(), settles.unwrap_or_default());
        // A recording that has ended first has no time for the command of the other one.
        let at_ns = difference.at_ns.iter().flatten().next().copied().unwrap_or_default();
        Event { at_ns, slave, kind: EventKind::Difference, text, code: None }
    }))
}

/// The time spans that the page shades: the states of all axes, and the gaps and states 0x18 of the board (slave 0).
fn spans(lines: &Lines) -> Vec<Span> {
    let span = |slave: u8, span: &states::Span| Span {
        slave,
        state: match span.state {
            State::NotEnabled => "not_enabled",
            State::Homing => "homing",
            State::Fault => "fault",
            State::Gap => "gap",
            State::Lost => "lost",
            State::Failed => "failed",
        },
        from: span.from,
        to: span.to,
        text: span.note.as_ref().map(|note| note.full.clone()).unwrap_or_default(),
    };
    let axes = lines.axes.iter().flat_map(|axis| axis.states.iter().map(move |state| span(axis.axis, state)));
    axes.chain(lines.gaps.iter().map(|state| span(0, state))).collect()
}

/// Makes an event at the beginning of each gap, loss of a slave and homing. The other states need no event here,
/// because [`Events`] finds alarms and states in the frames.
fn of_spans(spans: &[Span]) -> Vec<Event> {
    let event = |span: &Span| {
        let (kind, text) = match span.state {
            "gap" if span.slave != 0 => (EventKind::Gap, span.text.clone()),
            "lost" => (EventKind::Lost, span.text.clone()),
            "homing" => (EventKind::Drive, "homing".to_owned()),
            _ => return None,
        };
        Some(Event { at_ns: (span.from * 1e9).round() as i64, slave: span.slave, kind, text, code: None })
    };
    spans.iter().filter_map(event).collect()
}
