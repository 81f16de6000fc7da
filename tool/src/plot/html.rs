//! The page of a recording: one file that a browser opens from a disk. It has what the pictures have, of all slaves and in
//! full resolution, and the events of the run. The page itself is `tool/web/`.

use std::path::{Path, PathBuf};

use data_encoding::BASE64;
use ecmsk::ecm::{Scale, Scales};
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::Kinds;
use ecmsk::sk::SlotSize;
use ecmsk::sk::dump::MAX_SLAVES;

use super::decimate::Pieces;
use super::lanes::Way;
use super::series::{Lines, Series, Subject};
use super::states::{self, State};
use super::{Args, First, PlotError, Room, Window, file, first};
use crate::error::CliError;
use crate::filter::TimeOptions;
use crate::output;
use crate::output_file::{Kind, OutputFile, OverwriteOption};
use crate::stderr::say;
use crate::web::assembly::{Page, page};
use crate::web::channels::{Channels, Quantity};
use crate::web::codec;
use crate::web::events::{Event, EventKind, Events, Span};
use crate::web::hello::{self, FORMAT, Hello, Names, Words};
use crate::web::sampler::Sampler;

/// The number of columns to which a curve of the page is thinned. A minute at 1 kHz keeps every sample. \[OURS]
const COLUMNS: u32 = 200_000;

/// How many slaves a page shows at most: all of the network.
const ROOM: Room = Room { axes: MAX_SLAVES, slaves: MAX_SLAVES };

/// Whether the output file is a page: its name ends in `.html`.
pub fn is_asked(output: &Path) -> bool {
    output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("html"))
}

/// Writes the page to its file, and prints its path.
pub fn run(args: &Args, output: &Path) -> Result<(), CliError> {
    let file = OutputFile { file: output, option: "-o", kind: Kind::Page, replace: args.overwrite.replace() };
    let page = of_recording(args, || file::check_other(&file, &[&args.file]), None)?;
    file.write(page.html.as_bytes()).map_err(PlotError::from)?;
    Ok(output::print(format!("{}\n", output.display()))?)
}

impl Args {
    /// The options of `ecmsk plot FILE` for the page that `ecmsk serve web FILE` serves: it shows the whole recording, with all
    /// axes and times and without a title.
    pub fn of_file(
        file: &Path,
        machine: Option<PathBuf>,
        slot_size: Option<SlotSize>,
        counts_per_unit: Option<Scales>,
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
            counts_per_unit,
            machine,
            unit: None,
            slot_size,
            device: None,
        }
    }
}

/// Makes the page of a recording. `check` is called before the recording is read, so that a wrong output file is reported
/// at once. `connect` is as for [`page`].
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
    let Read { lines, mut channels, mut events } = read(args, &first, window, machine, &names)?;
    let mut block = channels.take_block();
    put(&mut block, &mut channels, &names, &lines);
    let spans = spans(&lines);
    events.with(of_spans(&spans));
    let mut notes: Vec<String> = first.damage.iter().map(ToString::to_string).collect();
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
        block: BASE64.encode(&block),
    };
    first.damage.iter().for_each(|damage| say("note", damage));
    let drawn = |error: serde_json::Error| PlotError::Draw { reason: error.to_string() };
    Ok(page(&title, Some(&hello), connect).map_err(drawn)?)
}

/// What a second reading of the recording gives: the curves of positions, targets and the like, the channels of all other
/// values, and the events.
struct Read {
    lines: Lines,
    channels: Channels,
    events: Events,
}

fn read(
    args: &Args,
    first: &First,
    window: Window,
    machine: Option<&MachineFile>,
    names: &Names,
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
        if framed.recorded.dir == ecmsk::link::Dir::Read && window.contains(at_ns) {
            sampler.report(&mut channels, names, at_ns, (frame, size), events.kinds());
        }
    })?;
    Ok(Read { lines: series.finish(), channels, events })
}

/// Adds the curves of the plot to the page's block of points. Each curve is a channel of the page. The curve is interrupted
/// where it has no values; each of its connected pieces becomes one record of the block.
fn put(block: &mut Vec<u8>, channels: &mut Channels, names: &Names, lines: &Lines) {
    let mut put = |slave, quantity: Quantity, bit, pieces: &Pieces| {
        if pieces.is_empty() {
            return;
        }
        let channel = channels.place((slave, quantity, bit), names);
        for piece in pieces {
            let point = |(s, value): &(f64, f64)| ((s * 1e9).round() as i64, (value / quantity.step()).round() as i64);
            codec::append(block, channel, true, &piece.iter().map(point).collect::<Vec<_>>());
        }
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

/// The time spans that the page shades: states of all axes, and gaps and state 0x18 of the board.
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

/// Makes an event at the beginning of each gap, loss of a slave and homing. The other spans need none: [`Events`] finds
/// alarms and states in the frames.
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
