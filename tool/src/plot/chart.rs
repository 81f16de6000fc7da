//! Draws the panels with any backend of the drawing library: SVG or pixels.

use std::fmt::Display;
use std::ops::Range;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::PlotError;
use super::panel::{Look, Panel};
use super::states::{Span, State};
use super::style::{self, at, px};

/// The text above the panels, and the common horizontal axis.
pub struct Caption {
    /// The title of the picture.
    pub title: String,
    /// The line below the title: the time range, the file, the number of frames.
    pub about: String,
    /// The range of the horizontal axis, in the unit that `axis` names.
    pub range: Range<f64>,
    /// The name and unit of the horizontal axis.
    pub axis: &'static str,
}

/// A picture: panels below each other. The panels over time come first and share one time axis.
pub struct Sheet {
    /// The diagrams, from top to bottom.
    pub panels: Vec<Panel>,
    /// The title and the common horizontal axis.
    pub caption: Caption,
}

type Area<B> = DrawingArea<B, Shift>;

impl Sheet {
    /// The height of the picture in pixels; its width is [`style::WIDTH`].
    pub fn height(&self) -> u32 {
        let heights = self.panels.iter().enumerate().map(|(i, panel)| style::PANEL_HEAD + panel.height + self.below(i));
        style::HEAD + heights.sum::<u32>()
    }

    /// The height in pixels of the horizontal axis below panel `i`. Panels over time share one axis, below the last of them;
    /// any other panel has its own.
    fn below(&self, i: usize) -> u32 {
        let of_time = |panel: &Panel| panel.across.is_none();
        let last = !self.panels[i + 1..].iter().any(of_time);
        if last || !of_time(&self.panels[i]) { style::TIME_AXIS } else { 0 }
    }

    /// Draws the picture.
    pub fn draw<B: DrawingBackend>(&self, backend: B) -> Result<(), PlotError> {
        let root = backend.into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let (head, mut rest) = root.split_vertically(at(style::HEAD));
        draw_caption(&head, &self.caption)?;
        for (i, panel) in self.panels.iter().enumerate() {
            let (head, below) = rest.split_vertically(at(style::PANEL_HEAD));
            draw_head(&head, panel)?;
            let axis = self.below(i);
            let (area, below) = below.split_vertically(at(panel.height + axis));
            draw_panel(&area, panel, &self.caption, axis)?;
            rest = below;
        }
        root.present().map_err(failed)
    }
}

fn draw_caption<B: DrawingBackend>(area: &Area<B>, caption: &Caption) -> Result<(), PlotError> {
    let width = style::WIDTH - style::RIGHT - 20;
    let title = style::fitting(&caption.title, style::TITLE, width);
    let about = style::fitting(&caption.about, style::TEXT, width);
    write(area, &title, (20, 22), style::TITLE, style::INK, HPos::Left)?;
    write(area, &about, (20, 46), style::TEXT, style::SOFT_INK, HPos::Left)
}

/// The widths of the parts of a legend item, in pixels: this constant is its sample line, the next ones are the space
/// before and after its text.
const SAMPLE: u32 = 22;
const GAP: u32 = 6;
const BETWEEN: u32 = 16;

/// Draws the name of a panel at the left and its legend at the right.
fn draw_head<B: DrawingBackend>(area: &Area<B>, panel: &Panel) -> Result<(), PlotError> {
    let middle = style::PANEL_HEAD / 2 + 2;
    write(area, &panel.name, (style::LEFT, middle), style::TEXT, style::INK, HPos::Left)?;
    let item = |text: &str| SAMPLE + GAP + style::text_width(text, style::TEXT) + BETWEEN;
    let legend: u32 = panel.legend.iter().map(|(_, text)| item(text)).sum();
    let mut x = (style::WIDTH - style::RIGHT + BETWEEN).saturating_sub(legend);
    for (look, text) in &panel.legend {
        match *look {
            Look::Area(_) => {
                let corners = [(at(x), at(middle - 6)), (at(x + SAMPLE), at(middle + 6))];
                area.draw(&Rectangle::new(corners, stroke(*look))).map_err(failed)?;
            }
            Look::Solid(_) | Look::Pale(_) => {
                let sample = vec![(at(x), at(middle)), (at(x + SAMPLE), at(middle))];
                area.draw(&PathElement::new(sample, stroke(*look))).map_err(failed)?;
            }
            Look::Dashed(_) => {
                let sample = vec![(at(x), at(middle)), (at(x + SAMPLE), at(middle))];
                area.draw(&DashedPathElement::new(sample, at(DASH), at(DASH), stroke(*look))).map_err(failed)?;
            }
        }
        write(area, text, (x + SAMPLE + GAP, middle), style::TEXT, style::SOFT_INK, HPos::Left)?;
        x += item(text);
    }
    Ok(())
}

fn draw_panel<B: DrawingBackend>(area: &Area<B>, panel: &Panel, caption: &Caption, axis: u32) -> Result<(), PlotError> {
    let across = panel.across.as_ref();
    let times = across.map_or(&caption.range, |across| &across.range).clone();
    let name = across.map_or(caption.axis, |across| &across.name);
    let width = across.map_or(style::WIDTH - style::LEFT - style::RIGHT, |across| across.width);
    let mut chart = ChartBuilder::on(area)
        .set_label_area_size(LabelAreaPosition::Left, px(style::LEFT))
        .set_label_area_size(LabelAreaPosition::Bottom, px(axis))
        .margin_right(px(style::WIDTH - style::LEFT - width))
        .build_cartesian_2d(times.clone(), panel.range.clone())
        .map_err(failed)?;
    let (bottom, top) = (panel.range.start, panel.range.end);
    // Shaded areas are drawn first, behind the grid, and are at least one pixel wide, so that short states stay
    // visible.
    let pixel = (times.end - times.start) / f64::from(width);
    let areas = panel.spans.iter().chain(&panel.other_spans).map(|span| {
        let least = pixel * if span.state == State::Gap { 2.0 } else { 1.0 };
        let corners = [(span.from, bottom), (span.to.max(span.from + least).min(times.end), top)];
        Rectangle::new(corners, stroke(span.state.look()))
    });
    chart.draw_series(areas).map_err(failed)?;
    let numbers = ("sans-serif", style::text_size(style::TEXT)).into_font().color(&style::SOFT_INK);
    let value_digits = style::digits(panel.range.end - panel.range.start);
    let time_digits = style::digits(times.end - times.start);
    let values = |value: &f64| style::number(*value, value_digits);
    let seconds = |value: &f64| style::number(*value, time_digits);
    let lanes = !panel.lanes.is_empty();
    let mut mesh = chart.configure_mesh();
    mesh.x_labels(if across.is_some() { 6 } else { 12 })
        .y_labels(if lanes { 0 } else { (panel.height / if across.is_some() { 48 } else { 24 }) as usize })
        .max_light_lines(0)
        .bold_line_style(style::GRID.stroke_width(px(1)))
        .axis_style(style::FRAME.stroke_width(px(1)))
        .label_style(numbers.clone())
        .x_label_formatter(&seconds)
        .y_label_formatter(&values)
        .set_tick_mark_size(LabelAreaPosition::Left, px(4))
        .set_tick_mark_size(LabelAreaPosition::Bottom, px(if axis == 0 { 0 } else { 4 }));
    if lanes {
        mesh.disable_y_mesh();
    }
    if axis > 0 {
        mesh.x_desc(name).axis_desc_style(numbers.color(&style::INK));
    }
    mesh.draw().map_err(failed)?;
    let marks = panel
        .marks
        .iter()
        .map(|at| PathElement::new(vec![(*at, bottom), (*at, top)], style::ALARM.stroke_width(px(1))));
    chart.draw_series(marks).map_err(failed)?;
    for line in &panel.strokes {
        let (alone, pieces): (Vec<_>, Vec<_>) = line.pieces.iter().partition(|piece| piece.len() == 1);
        let style = stroke(line.look);
        if matches!(line.look, Look::Dashed(_)) {
            let dashed = |piece: &Vec<(f64, f64)>| DashedPathElement::new(piece.clone(), at(DASH), at(DASH), style);
            chart.draw_series(pieces.into_iter().map(dashed)).map_err(failed)?;
        } else {
            chart
                .draw_series(pieces.into_iter().map(|piece| PathElement::new(piece.clone(), style)))
                .map_err(failed)?;
        }
        // A piece with a single sample is drawn as a dot, because a line through one point is invisible.
        let dots = alone.into_iter().flatten().map(|sample| Circle::new(*sample, px(2), style.filled()));
        chart.draw_series(dots).map_err(failed)?;
    }
    for (i, lane) in (0..).zip(&panel.lanes) {
        let y = i * style::LANE + style::LANE / 2;
        write(area, lane, (style::LEFT - 8, y), style::SMALL, style::SOFT_INK, HPos::Right)?;
    }
    draw_ends(area, panel)?;
    draw_notes(area, &panel.spans, NOTES, &times)?;
    draw_notes(area, &panel.other_spans, OTHER_NOTES, &times)
}

/// The length of a dash and of the gap after it, in pixels.
const DASH: u32 = 5;

/// Draws the texts at the ends of lines from top to bottom. A text that would overlap the previous one moves below it.
fn draw_ends<B: DrawingBackend>(area: &Area<B>, panel: &Panel) -> Result<(), PlotError> {
    let mut ends: Vec<_> = panel.ends.iter().collect();
    ends.sort_by(|a, b| b.0.total_cmp(&a.0));
    let span = panel.range.end - panel.range.start;
    let mut free_from = style::SMALL / 2;
    for (left, (value, text, colour)) in (0..ends.len() as u32).rev().zip(ends) {
        let wanted = (f64::from(panel.height) * (panel.range.end - value) / span) as u32;
        let last = panel.height.saturating_sub(style::SMALL / 2 + left * style::SMALL);
        let y = wanted.max(free_from).min(last.max(free_from));
        write(area, text, (style::WIDTH - style::RIGHT + 4, y), style::SMALL, *colour, HPos::Left)?;
        free_from = y + style::SMALL;
    }
    Ok(())
}

/// The distance in pixels from the top of a panel to the notes on states. The next constant is for the states of a
/// second recording.
const NOTES: u32 = 10;
const OTHER_NOTES: u32 = 26;

/// Draws the notes on states in one line, `y` pixels below the top of the panel. Each note begins at the left edge of
/// its state. If the full text does not fit before the next note, the brief text is drawn. A note that would overlap an
/// earlier one is left out.
fn draw_notes<B: DrawingBackend>(area: &Area<B>, spans: &[Span], y: u32, times: &Range<f64>) -> Result<(), PlotError> {
    let right = style::WIDTH - style::RIGHT;
    let pixels = f64::from(right - style::LEFT) / (times.end - times.start);
    let begin = |span: &Span| style::LEFT + ((span.from - times.start) * pixels) as u32 + GAP / 2;
    let mut noted = spans.iter().filter_map(|span| Some((begin(span), span.note.as_ref()?))).peekable();
    let mut free_from = style::LEFT;
    while let Some((begin, note)) = noted.next() {
        let end = noted.peek().map_or(right, |(next, _)| *next);
        let placed = |text: &str| {
            let width = style::text_width(text, style::TEXT) + GAP;
            (begin.min(right.saturating_sub(width)), width)
        };
        let (x, width) = placed(&note.full);
        let is_full = x >= free_from && x + width <= end;
        let (text, (x, width)) = if is_full { (&note.full, (x, width)) } else { (&note.brief, placed(&note.brief)) };
        if x >= free_from {
            write(area, text, (x, y), style::TEXT, style::ALARM, HPos::Left)?;
            free_from = x + width;
        }
    }
    Ok(())
}

fn write<B: DrawingBackend>(
    area: &Area<B>,
    text: &str,
    (x, y): (u32, u32),
    size: u32,
    colour: RGBColor,
    anchor: HPos,
) -> Result<(), PlotError> {
    let font = ("sans-serif", style::text_size(size)).into_font();
    let style = font.color(&colour).pos(Pos::new(anchor, VPos::Center));
    area.draw_text(text, &style, (at(x), at(y))).map_err(failed)
}

fn stroke(look: Look) -> ShapeStyle {
    match look {
        Look::Solid(colour) | Look::Dashed(colour) => {
            ShapeStyle { color: colour.to_rgba(), filled: false, stroke_width: px(3) / 2 }
        }
        Look::Pale(colour) => colour.mix(0.35).stroke_width(px(5)),
        Look::Area(colour) => colour.filled(),
    }
}

fn failed(error: impl Display) -> PlotError {
    PlotError::Draw { reason: error.to_string() }
}
