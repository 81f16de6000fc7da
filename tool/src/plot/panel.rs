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
    Some(distinct(bottom - room..top + room))
}

/// The range, or one near it whose marks are different numbers, and not infinite: whoever counts from mark to mark would never
/// arrive.
pub fn distinct(range: Range<f64>) -> Range<f64> {
    let [start, end] = [range.start, range.end].map(|end| end.clamp(-GREATEST, GREATEST));
    let least = start.abs().max(end.abs()) * 1e-12;
    if end - start >= least { start..end } else { start - least..end + least }
}

/// No axis goes beyond, so that its length is a number too.
const GREATEST: f64 = 1e307;

#[cfg(test)]
mod tests {
    use super::*;

    /// TOOL-145 A picture has an end: of a value far from 0 that hardly changes the marks can be told apart.
    #[test]
    fn marks_of_an_axis_show_different_numbers() {
        for range in [9e9..9e9 + 4e-6, 1e300..1e300, -9e9 - 2e-6..-9e9] {
            let Range { start, end } = distinct(range.clone());
            assert!(start <= range.start && range.end <= end, "{range:?}");
            let mark = (end - start) / 100.0;
            assert!(start + mark > start && end - mark < end && start + 2.0 * mark > start + mark, "{range:?}");
        }
        assert_eq!(distinct(0.0..1e-9), 0.0..1e-9);
        let all = distinct(f64::NEG_INFINITY..f64::INFINITY);
        assert!((all.end - all.start).is_finite() && all.start < all.end);
        let a_count = f64::from(i32::MAX) - 1.0..f64::from(i32::MAX);
        assert_eq!(distinct(a_count.clone()), a_count);
    }
}
