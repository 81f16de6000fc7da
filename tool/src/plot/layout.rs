//! The panels of a plot, from top to bottom, with their legends.

use ecmsk::machine_file::MachineFile;
use ecmsk::sk::FIFO_ENTRIES;
use plotters::style::RGBColor;

use super::beside::Beside;
use super::chosen::{Asked, Diagram};
use super::decimate::Pieces;
use super::lanes::{Lane, Way};
use super::panel::{self, Across, Look, Panel, Stroke};
use super::series::Lines;
use super::states::{Span, State};
use super::style;
use crate::machine_option::label;
use crate::output::counted;

/// With more axes than this, their colours are too similar to distinguish them, so dashes and labels are added. \[OURS]
const CROWD: usize = 4;
/// The height in pixels of a diagram that shows all axes together.
const SHARED: u32 = 130;

/// How axes and the units of their positions are named.
pub struct Names<'a> {
    /// The unit of positions in panels that show all axes together: `units` if the axes have different units.
    pub unit: String,
    /// The machine file, with the names of axes.
    pub machine: Option<&'a MachineFile>,
    /// Whether each axis has its own unit, from the machine file.
    pub has_own_units: bool,
}

impl<'a> Names<'a> {
    /// Takes the names and units from the machine file. If the axes have different units, the unit in shared panels is
    /// called `units`.
    pub fn of_machine(axes: &[u8], machine: Option<&'a MachineFile>) -> Self {
        let unit = |axis: &u8| machine.and_then(|machine| machine.axis_of(*axis)).map(|axis| axis.unit);
        let mut units = axes.iter().map(|axis| unit(axis).unwrap_or_default());
        let first = units.next().unwrap_or_default();
        let unit = if units.all(|unit| unit == first) { first.word() } else { "units" };
        Self { unit: unit.to_owned(), machine, has_own_units: true }
    }

    fn axis(&self, slave: u8) -> String {
        label(self.machine, slave)
    }

    fn unit_of(&self, slave: u8) -> &str {
        let own = self.machine.filter(|_| self.has_own_units).and_then(|machine| machine.axis_of(slave));
        own.map_or(&*self.unit, |axis| axis.unit.word())
    }
}

/// Makes the panels; curves without data get no panel. `plane` gives the two axes whose path is drawn in a diagram of
/// its own.
pub fn panels(
    lines: Lines,
    asked: &Asked,
    plane: Option<[u8; 2]>,
    names: &Names<'_>,
    mut beside: Beside,
) -> Vec<Panel> {
    let Lines { axes, ios, plane: paths, fifo_free, full, full_reports, gaps } = lines;
    // The more axes there are, the lower their diagrams, so that the plot fits on a screen.
    let height = match axes.len() {
        ..=2 => 190,
        3..=4 => 140,
        _ => 100,
    };
    let by_velocity = axes.iter().any(|axis| !axis.target_velocity.is_empty() || !axis.target_torque.is_empty());
    let colours = style::colours(axes.iter().map(|axis| axis.axis));
    let is_crowded = axes.len() > CROWD;
    let failed: Vec<f64> = gaps.iter().filter(|span| span.state == State::Failed).map(|span| span.from).collect();
    let mut all = Vec::new();
    let mut shared = Shared { least: f64::MAX, ..Shared::default() };
    for (place, (axis, colour)) in axes.into_iter().zip(colours).enumerate() {
        // With many axes every second line is dashed, so that similar colours can be distinguished.
        let solid = if is_crowded && place % 2 == 1 { Look::Dashed(colour) } else { Look::Solid(colour) };
        let pale = Look::Pale(colour);
        if is_crowded {
            shared.ends.push((names.axis(axis.axis), colour));
        }
        let least = axis.scale.to_units(1).abs();
        shared.least = shared.least.min(least);
        shared.legend.push((solid, format!("axis {}", names.axis(axis.axis))));
        shared.commanded.push(Stroke { pieces: axis.commanded_velocity, look: pale });
        shared.velocity.push(Stroke { pieces: axis.velocity, look: solid });
        shared.target_velocity.push(Stroke { pieces: axis.target_velocity, look: pale });
        shared.difference.push(Stroke { pieces: axis.difference, look: solid });
        shared.target_torque.push(Stroke { pieces: axis.target_torque, look: pale });
        shared.torque.push(Stroke { pieces: axis.torque, look: solid });
        if !asked.shows(Diagram::Position, true) {
            continue;
        }
        let mut legend = vec![(solid, "actual".to_owned())];
        if !axis.target.is_empty() {
            legend.insert(0, (pale, "target, when executed".to_owned()));
        }
        let faults = beside.faults.extract_if(.., |(slave, _)| *slave == axis.axis).next();
        let other_spans = faults.map(|(_, spans)| spans).unwrap_or_default();
        for state in [State::NotEnabled, State::Homing, State::Fault, State::Gap, State::Lost] {
            if axis.states.iter().chain(&other_spans).any(|span| span.state == state) {
                legend.push((state.look(), state.name().to_owned()));
            }
        }
        let mut strokes =
            vec![Stroke { pieces: axis.target, look: pale }, Stroke { pieces: axis.position, look: solid }];
        if let Some((_, pieces)) = beside.positions.extract_if(.., |(slave, _)| *slave == axis.axis).next() {
            let look = Look::Solid(style::BESIDE);
            legend.push((look, format!("actual, {}", beside.name)));
            strokes.push(Stroke { pieces, look });
        }
        if !failed.is_empty() {
            legend.push((Look::Solid(style::ALARM), State::Failed.name().to_owned()));
        }
        let name = format!("Axis {}: position ({})", names.axis(axis.axis), names.unit_of(axis.axis));
        let panel = Panel::of(name, height, least, strokes, legend);
        let other_zero = beside.zeroed.iter().filter(|(slave, _)| *slave == axis.axis).map(|(_, at)| *at);
        let panel = panel.map(|panel| match other_zero.chain(axis.zeroed).reduce(f64::max) {
            Some(since) => panel.scaled_since(since, least),
            None => panel,
        });
        all.extend(panel.map(|panel| Panel { spans: axis.states, other_spans, marks: failed.clone(), ..panel }));
    }
    let least = shared.least;
    all.extend(shared.panels(asked, &names.unit, by_velocity));
    if asked.shows(Diagram::Io, true) {
        all.extend(ios.into_iter().filter_map(|(slave, lanes)| io(slave, lanes)));
    }
    if asked.shows(Diagram::Fifo, true) {
        all.push(fifo(fifo_free, full, full_reports, gaps));
    }
    all.extend(paths.zip(plane).and_then(|(paths, axes)| in_the_plane(paths, axes, names, least)));
    all
}

/// The curves of all axes for the panels that show all axes together.
#[derive(Default)]
struct Shared {
    /// The smallest length of one count among all axes, in units. The vertical axes of shared panels have no finer
    /// steps.
    least: f64,
    legend: Vec<(Look, String)>,
    /// For each axis, the text at the right end of its curve (the axis name) and its colour; empty if there are few
    /// axes.
    ends: Vec<(String, RGBColor)>,
    commanded: Vec<Stroke>,
    velocity: Vec<Stroke>,
    target_velocity: Vec<Stroke>,
    difference: Vec<Stroke>,
    target_torque: Vec<Stroke>,
    torque: Vec<Stroke>,
}

impl Shared {
    fn panels(self, asked: &Asked, unit: &str, by_velocity: bool) -> impl Iterator<Item = Panel> {
        let panel = |name: &str, least: f64, behind: Vec<Stroke>, before: Vec<Stroke>| {
            let of_axes = if before.is_empty() { &behind } else { &before };
            let value = |stroke: &Stroke| stroke.pieces.last()?.last().map(|(_, value)| *value);
            let ends = of_axes.iter().map(value).zip(&self.ends);
            let ends = ends.filter_map(|(value, (text, colour))| Some((value?, text.clone(), *colour))).collect();
            let strokes = behind.into_iter().chain(before).collect();
            let panel = Panel::of(name.to_owned(), SHARED, least, strokes, self.legend.clone());
            panel.map(|panel| Panel { ends, ..panel })
        };
        let commanded = |strokes: &[Stroke]| strokes.iter().any(|stroke| !stroke.pieces.is_empty());
        let velocity = format!("Velocity ({unit}/s; pale: of the targets)");
        let torque = match commanded(&self.target_torque) {
            true => "Torque (% of rated; pale: target, when executed)",
            false => "Torque (% of rated)",
        };
        [
            // The target velocity of CSV is in the drive's own unit, so it has a panel of its own.
            asked.shows(Diagram::Velocity, true).then(|| {
                panel("Target velocity (as the drive scales it, when executed)", 1.0, self.target_velocity, vec![])
            }),
            asked
                .shows(Diagram::Velocity, by_velocity)
                .then(|| panel(&velocity, 100.0 * self.least, self.commanded, self.velocity)),
            asked
                .shows(Diagram::Difference, false)
                .then(|| panel(&format!("Following difference ({unit})"), self.least, self.difference, vec![])),
            asked.shows(Diagram::Torque, true).then(|| panel(torque, 0.1, self.target_torque, self.torque)),
        ]
        .into_iter()
        .flatten()
        .flatten()
    }
}

/// The panel with the inputs and outputs of a slave, one lane each. Bits that are always 0 are left out.
fn io(slave: u8, lanes: Vec<Lane>) -> Option<Panel> {
    let count = lanes.len();
    let way = |way: Way| match way {
        Way::In => (style::INPUT, "in"),
        Way::Out => (style::OUTPUT, "out"),
    };
    let mut legend = Vec::new();
    for (kind, name) in [(Way::In, "input, as last read"), (Way::Out, "output, when executed")] {
        if lanes.iter().any(|lane| lane.way == kind) {
            legend.push((Look::Solid(way(kind).0), name.to_owned()));
        }
    }
    let names = lanes.iter().map(|lane| format!("{} {}", way(lane.way).1, lane.bit)).collect();
    let strokes = lanes.into_iter().enumerate().map(|(i, lane)| {
        let base = (count - 1 - i) as f64 + 0.2;
        let lift = |(seconds, value): (f64, f64)| (seconds, base + 0.6 * value);
        let pieces = lane.values.into_iter().map(|piece| piece.into_iter().map(lift).collect()).collect();
        Stroke { pieces, look: Look::Solid(way(lane.way).0) }
    });
    let strokes: Vec<Stroke> = strokes.collect();
    (count > 0).then(|| Panel {
        name: format!("IO {slave}: inputs and outputs (those that are always 0 are left out)"),
        height: count as u32 * style::LANE,
        range: 0.0..count as f64,
        strokes,
        legend,
        lanes: names,
        ..Panel::default()
    })
}

fn fifo(free: Pieces, full: Vec<f64>, full_reports: u64, gaps: Vec<Span>) -> Panel {
    let mut legend = vec![(Look::Solid(style::FIFO), "free entries".to_owned())];
    for state in [State::Gap, State::Failed] {
        if gaps.iter().any(|span| span.state == state) {
            legend.push((state.look(), state.name().to_owned()));
        }
    }
    if full_reports > 0 {
        let reports = counted(full_reports, "report");
        let text = format!("commands lost: the full count went up in {reports}");
        legend.push((Look::Solid(style::ALARM), text));
    }
    let strokes = vec![Stroke { pieces: free, look: Look::Solid(style::FIFO) }];
    let range = -4.0..f64::from(FIFO_ENTRIES) + 8.0;
    let name = format!("FIFO: free entries of {FIFO_ENTRIES}");
    // The FIFO panel shows gaps without notes, because the panels of the axes show their lengths.
    let spans = gaps.into_iter().map(|span| match span.state {
        State::Gap => Span { note: None, ..span },
        _ => span,
    });
    let spans = spans.collect();
    Panel { name, height: 110, range, strokes, spans, marks: full, legend, ..Panel::default() }
}

/// The panel with the path of two axes in their plane, both axes drawn to the same scale.
fn in_the_plane([target, gone]: [Pieces; 2], [x, y]: [u8; 2], names: &Names<'_>, least: f64) -> Option<Panel> {
    let (width, height) = style::PLANE;
    let colour = style::colours([x])[0];
    let strokes =
        vec![Stroke { pieces: target, look: Look::Pale(colour) }, Stroke { pieces: gone, look: Look::Solid(colour) }];
    let ranges = [panel::range(&strokes, |point| point.0, least)?, panel::range(&strokes, |point| point.1, least)?];
    let spans = [&ranges[0], &ranges[1]].map(|range| range.end - range.start);
    let per_pixel = (spans[0] / f64::from(width)).max(spans[1] / f64::from(height));
    let [across, range] = [(&ranges[0], width), (&ranges[1], height)].map(|(range, pixels)| {
        let (middle, half) = ((range.start + range.end) / 2.0, per_pixel * f64::from(pixels) / 2.0);
        middle - half..middle + half
    });
    let ([x_unit, y_unit], [x, y]) = ([x, y].map(|axis| names.unit_of(axis)), [x, y].map(|axis| names.axis(axis)));
    let name = format!("Plane of axes {x} and {y}: position of axis {y} ({y_unit})");
    let legend =
        vec![(Look::Pale(colour), "targets, when executed".to_owned()), (Look::Solid(colour), "actual".to_owned())];
    let across = Across { range: across, name: format!("position of axis {x} ({x_unit})"), width };
    Some(Panel { name, height, range, strokes, legend, across: Some(across), ..Panel::default() })
}
