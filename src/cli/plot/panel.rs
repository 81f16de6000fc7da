//! What the panels of a picture show.

use std::ops::Range;

use plotters::style::RGBColor;

use super::series::Pieces;
use super::states::{Span, State};
use super::style;

/// One of the diagrams that stand under each other.
#[derive(Default)]
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
    /// What stands at the left in the place of numbers, from top to bottom; each has 1 of the range.
    pub lanes: Vec<String>,
    /// What goes from left to right, if that is not what it is in the other panels.
    pub across: Option<Across>,
}

/// What goes from left to right in a panel of its own kind.
pub struct Across {
    /// Values from left to right.
    pub range: Range<f64>,
    /// Name and unit.
    pub name: String,
    /// Width of the diagram, pixels.
    pub width: u32,
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
            Self::Gap => style::GAP,
        })
    }

    /// Its name in a legend.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotEnabled => "not enabled",
            Self::Homing => "homing",
            Self::Fault => "fault",
            Self::Gap => "gap: FIFO empty on the way",
        }
    }
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
        let range = range(&strokes, |point| point.1, least)?;
        Some(Self { name, height, range, strokes, legend, ..Self::default() })
    }
}

/// From the least to the greatest value and some room; `None` if there are no lines. `least`: the smallest step of a value.
pub fn range(strokes: &[Stroke], of: fn(&(f64, f64)) -> f64, least: f64) -> Option<Range<f64>> {
    let values = || strokes.iter().flat_map(|stroke| stroke.pieces.iter().flatten()).map(of);
    let bottom = values().reduce(f64::min)?;
    let top = values().reduce(f64::max)?;
    // A value that never changes lies in the middle, with some steps of it around.
    let room = ((top - bottom) * 0.08).max(least * 5.0 * f64::from(u8::from(top == bottom)));
    Some(bottom - room..top + room)
}
