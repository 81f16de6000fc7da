//! What the panels of a plot show.

use std::ops::Range;

use ecmsk::sk::FIFO_ENTRIES;
use plotters::style::RGBColor;

use super::series::{AxisLines, Lines, Pieces};
use super::states::{Span, State};
use super::style;

/// One of the diagrams that stand under each other.
pub struct Panel {
    /// What it shows, with the unit.
    pub name: String,
    /// Height of the diagram, pixels.
    pub height: u32,
    /// Values from bottom to top.
    pub range: Range<f64>,
    /// The lines, those behind first.
    pub strokes: Vec<Stroke>,
    /// States, behind all else.
    pub spans: Vec<Span>,
    /// Times to mark from bottom to top, seconds.
    pub marks: Vec<f64>,
    /// Explanation, from left to right.
    pub legend: Vec<(Look, String)>,
}

/// A line.
pub struct Stroke {
    /// Its pieces.
    pub pieces: Pieces,
    /// How it looks.
    pub look: Look,
}

/// How something looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// A line.
    Solid(RGBColor),
    /// A pale and broad line: what was commanded, behind what was done.
    Pale(RGBColor),
    /// An area.
    Area(RGBColor),
}

impl State {
    /// How it looks behind the lines.
    pub const fn look(self) -> Look {
        Look::Area(match self {
            Self::NotEnabled => style::NOT_ENABLED,
            Self::Homing => style::HOMING,
            Self::Fault => style::FAULT,
        })
    }

    const fn name(self) -> &'static str {
        match self {
            Self::NotEnabled => "not enabled",
            Self::Homing => "homing",
            Self::Fault => "fault",
        }
    }
}

/// The panels, from top to bottom. A kind of line that there is none of has no panel; the FIFO always has.
pub fn panels(lines: Lines) -> Vec<Panel> {
    let Lines { axes, fifo_free, full, full_reports, with_difference } = lines;
    // Many axes get less room each, so that a plot stays on a screen.
    let height = match axes.len() {
        ..=2 => 190,
        3..=4 => 140,
        _ => 100,
    };
    let colours = style::colours(axes.iter().map(|axis| axis.axis));
    let mut all = Vec::new();
    let mut shared = Shared::default();
    for (axis, colour) in axes.into_iter().zip(colours) {
        let AxisLines { axis, target, position, difference, target_velocity, target_torque, torque, states } = axis;
        shared.axes.push((Look::Solid(colour), format!("axis {axis}")));
        shared.velocity.push(Stroke { pieces: target_velocity, look: Look::Pale(colour) });
        shared.difference.push(Stroke { pieces: difference, look: Look::Solid(colour) });
        shared.target_torque.push(Stroke { pieces: target_torque, look: Look::Pale(colour) });
        shared.torque.push(Stroke { pieces: torque, look: Look::Solid(colour) });
        let mut legend = vec![(Look::Solid(colour), "actual".to_owned())];
        if !target.is_empty() {
            legend.insert(0, (Look::Pale(colour), "target, as sent".to_owned()));
        }
        for state in [State::NotEnabled, State::Homing, State::Fault] {
            if states.iter().any(|span| span.state == state) {
                legend.push((state.look(), state.name().to_owned()));
            }
        }
        let strokes = vec![
            Stroke { pieces: target, look: Look::Pale(colour) },
            Stroke { pieces: position, look: Look::Solid(colour) },
        ];
        let name = format!("Axis {axis}: position (counts)");
        let panel = Panel::of(name, height, 1.0, strokes, legend);
        all.extend(panel.map(|panel| Panel { spans: states, ..panel }));
    }
    all.extend(shared.panels(with_difference));
    all.push(fifo(fifo_free, full, full_reports));
    all
}

/// Lines of all axes that share panels.
#[derive(Default)]
struct Shared {
    axes: Vec<(Look, String)>,
    velocity: Vec<Stroke>,
    difference: Vec<Stroke>,
    target_torque: Vec<Stroke>,
    torque: Vec<Stroke>,
}

impl Shared {
    fn panels(self, with_difference: bool) -> impl Iterator<Item = Panel> {
        const HEIGHT: u32 = 130;
        let axes = || self.axes.clone();
        let velocity = Panel::of("Target velocity, as sent".into(), HEIGHT, 1.0, self.velocity, axes());
        let name = "Following difference (counts)";
        let difference = Panel::of(name.into(), HEIGHT, 1.0, self.difference, axes());
        let commanded = self.target_torque.iter().any(|stroke| !stroke.pieces.is_empty());
        let name = if commanded { "Torque (% of rated; pale: target, as sent)" } else { "Torque (% of rated)" };
        let torque =
            Panel::of(name.into(), HEIGHT, 0.1, self.target_torque.into_iter().chain(self.torque).collect(), axes());
        velocity.into_iter().chain(difference.filter(|_| with_difference)).chain(torque)
    }
}

fn fifo(free: Pieces, full: Vec<f64>, full_reports: u64) -> Panel {
    let mut legend = vec![(Look::Solid(style::FIFO), "free entries".to_owned())];
    if full_reports > 0 {
        let plural = if full_reports == 1 { "" } else { "s" };
        let text = format!("commands lost: the full count went up in {full_reports} report{plural}");
        legend.push((Look::Solid(style::ALARM), text));
    }
    let strokes = vec![Stroke { pieces: free, look: Look::Solid(style::FIFO) }];
    let range = -4.0..f64::from(FIFO_ENTRIES) + 8.0;
    let name = format!("FIFO: free entries of {FIFO_ENTRIES}");
    Panel { name, height: 110, range, strokes, spans: Vec::new(), marks: full, legend }
}

impl Panel {
    /// A panel whose values fit; `None` if there are no lines. `least`: the smallest step of a value.
    pub fn of(
        name: String,
        height: u32,
        least: f64,
        strokes: Vec<Stroke>,
        legend: Vec<(Look, String)>,
    ) -> Option<Self> {
        let values = || strokes.iter().flat_map(|stroke| stroke.pieces.iter().flatten()).map(|(_, value)| *value);
        let bottom = values().reduce(f64::min)?;
        let top = values().reduce(f64::max)?;
        // A value that never changes lies in the middle, with some steps of it around.
        let room = ((top - bottom) * 0.08).max(least * 5.0 * f64::from(u8::from(top == bottom)));
        let range = bottom - room..top + room;
        Some(Self { name, height, range, strokes, spans: Vec::new(), marks: Vec::new(), legend })
    }
}
