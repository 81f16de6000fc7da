//! A panel: one diagram of a picture, with its axes, curves and legend.

use std::ops::Range;

use plotters::style::RGBColor;

use super::decimate::Pieces;
use super::states::{Span, State};
use super::style;

/// One diagram of a picture.
#[derive(Default)]
pub struct Panel {
    /// The name of the diagram, with the unit.
    pub name: String,
    /// The height of the diagram in pixels.
    pub height: u32,
    /// The range of the vertical axis, in the unit that `name` ends with.
    pub range: Range<f64>,
    /// The curves, in the order of drawing.
    pub strokes: Vec<Stroke>,
    /// States, drawn as shaded areas behind everything else.
    pub spans: Vec<Span>,
    /// States of a second recording, drawn like `spans`, but with their notes one line lower.
    pub other_spans: Vec<Span>,
    /// Times in seconds that are marked by vertical lines.
    pub marks: Vec<f64>,
    /// The legend, from left to right.
    pub legend: Vec<(Look, String)>,
    /// The names of lanes (the bits of an IO slave), from top to bottom. Each lane has a height of 1 on the vertical
    /// axis. If empty, the axis has numbers.
    pub lanes: Vec<String>,
    /// The horizontal axis of this panel, if it is not the common time axis.
    pub across: Option<Across>,
    /// The texts at the right ends of curves: the curve's last value, the text, its colour.
    pub ends: Vec<(f64, String, RGBColor)>,
}

/// The horizontal axis of a panel that does not use the common time axis.
pub struct Across {
    /// The range of the axis.
    pub range: Range<f64>,
    /// The name and unit of the axis.
    pub name: String,
    /// The width of the diagram in pixels.
    pub width: u32,
}

/// A curve of a diagram.
pub struct Stroke {
    /// The pieces of the curve; between them it is interrupted.
    pub pieces: Pieces,
    /// The style of the curve.
    pub look: Look,
}

/// The style of a line or an area.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// A solid line.
    Solid(RGBColor),
    /// A line of dashes.
    Dashed(RGBColor),
    /// A pale and broad line for commanded values, behind the actual ones.
    Pale(RGBColor),
    /// A shaded area.
    Area(RGBColor),
}

impl State {
    /// The style of the shaded area in which a panel shows this state of a drive or of the board.
    pub const fn look(self) -> Look {
        Look::Area(match self {
            Self::NotEnabled => style::NOT_ENABLED,
            Self::Homing => style::HOMING,
            Self::Fault => style::FAULT,
            Self::Gap => style::GAP,
            Self::Lost => style::LOST,
            Self::Failed => style::FAILED,
        })
    }

    /// The name of the state in a legend.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotEnabled => "not enabled",
            Self::Homing => "homing",
            Self::Fault => "fault",
            Self::Gap => "gap: FIFO empty on the way",
            Self::Lost => "lost: slot without news in state 0x18",
            Self::Failed => "state 0x18",
        }
    }
}

impl Panel {
    /// A panel whose vertical axis fits the values; `None` if no curve has values. `least` is the smallest possible
    /// step of a value. It keeps the axis of a constant value from being scaled to rounding errors.
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

    /// The same panel with its vertical axis scaled to the values from the time `since` (seconds) on. Earlier values
    /// outside the range of the axis are cut off.
    #[must_use]
    pub fn scaled_since(mut self, since: f64, least: f64) -> Self {
        let later = |piece: &Vec<(f64, f64)>| piece.iter().copied().filter(|(at, _)| *at >= since).collect();
        let later = |stroke: &Stroke| Stroke { pieces: stroke.pieces.iter().map(later).collect(), look: stroke.look };
        let later: Vec<Stroke> = self.strokes.iter().map(later).collect();
        if let Some(range) = range(&later, |point| point.1, least) {
            for stroke in &mut self.strokes {
                stroke.pieces = stroke.pieces.iter().flat_map(|piece| within(piece, &range)).collect();
            }
            self.range = range;
        }
        self
    }
}

/// The parts of a piece of a curve whose values are within the range. Lines that cross a limit are cut exactly there.
fn within(piece: &[(f64, f64)], range: &Range<f64>) -> Pieces {
    let mut parts = Pieces::new();
    let mut goes_on = false;
    let is_in = |value: f64| range.start <= value && value <= range.end;
    if let [(_, value)] = piece {
        return if is_in(*value) { vec![piece.to_vec()] } else { parts };
    }
    for pair in piece.windows(2) {
        let [(from, a), (to, b)] = [pair[0], pair[1]];
        // The fraction of the line from point a to point b, 0 to 1, at which it has this value.
        let at = |value: f64| if a == b { 0.0 } else { (value - a) / (b - a) };
        let (enters, leaves) = match (a == b, is_in(a)) {
            (true, true) => (0.0, 1.0),
            (true, false) => (1.0, 0.0),
            (false, _) => (at(range.start).min(at(range.end)).max(0.0), at(range.start).max(at(range.end)).min(1.0)),
        };
        if enters > leaves {
            goes_on = false;
            continue;
        }
        let point = |part: f64| (from + (to - from) * part, (a + (b - a) * part).clamp(range.start, range.end));
        match parts.last_mut().filter(|_| goes_on && enters == 0.0) {
            Some(part) => part.push(point(leaves)),
            None => parts.push(vec![point(enters), point(leaves)]),
        }
        goes_on = leaves == 1.0;
    }
    parts
}

/// The range of all values with some margin; `None` if there are no values. `of` selects the coordinate of a point,
/// `least` is the smallest possible step of a value.
pub fn range(strokes: &[Stroke], of: fn(&(f64, f64)) -> f64, least: f64) -> Option<Range<f64>> {
    let values = || strokes.iter().flat_map(|stroke| stroke.pieces.iter().flatten()).map(of);
    let bottom = values().reduce(f64::min)?;
    let top = values().reduce(f64::max)?;
    // A constant value is drawn in the middle of a range of ten steps.
    let room = ((top - bottom) * 0.08).max(least * 5.0 * f64::from(u8::from(top == bottom)));
    Some(distinct(bottom - room..top + room))
}

/// The range, widened if it is too short for floating-point numbers to distinguish the tick marks of the axis. Without
/// this, the drawing library would draw tick marks forever.
pub fn distinct(range: Range<f64>) -> Range<f64> {
    let [start, end] = [range.start, range.end].map(|end| end.clamp(-VALUE_MAX, VALUE_MAX));
    let least = start.abs().max(end.abs()) * 1e-12;
    if end - start >= least { start..end } else { start - least..end + least }
}

/// The largest absolute value at the end of an axis. With larger values the length of the axis would not be finite.
const VALUE_MAX: f64 = 1e307;

#[cfg(test)]
mod tests {
    use super::*;

    /// A line is cut where it leaves the range, and continues where it returns.
    #[test]
    fn a_line_is_cut_at_the_range() {
        let line = [(0.0, 5.0), (1.0, 5.0), (2.0, 15.0), (3.0, 15.0), (4.0, -5.0), (5.0, 5.0)];
        let parts = within(&line, &(0.0..10.0));
        let (from, to) = (vec![(0.0, 5.0), (1.0, 5.0), (1.5, 10.0)], vec![(3.25, 10.0), (3.75, 0.0)]);
        assert_eq!(parts, [from, to, vec![(4.5, 0.0), (5.0, 5.0)]]);
        assert!(within(&[(0.0, 11.0)], &(0.0..10.0)).is_empty());
        assert_eq!(within(&[(0.0, 1.0)], &(0.0..10.0)), [vec![(0.0, 1.0)]]);
    }

    /// Drawing an axis terminates and its tick marks have different numbers, even for large values that hardly change.
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
