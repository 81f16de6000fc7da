//! Draws the panels.

use std::fmt::Display;
use std::ops::Range;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::PlotError;
use super::panel::{Look, Panel};
use super::style::{self, at, px};

/// What stands above the panels.
pub struct Caption {
    /// In large letters.
    pub title: String,
    /// Below it.
    pub about: String,
    /// What is shown, from left to right.
    pub range: Range<f64>,
    /// Name and unit of that.
    pub axis: &'static str,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The plot as SVG.
pub fn draw(panels: &[Panel], caption: &Caption) -> Result<String, PlotError> {
    let heights: u32 = panels.iter().map(|panel| style::PANEL_HEAD + panel.height).sum();
    let height = style::HEAD + heights + style::TIME_AXIS;
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (px(style::WIDTH), px(height))).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let (head, mut rest) = root.split_vertically(at(style::HEAD));
        draw_caption(&head, caption)?;
        let last = panels.len().saturating_sub(1);
        for (i, panel) in panels.iter().enumerate() {
            let (head, below) = rest.split_vertically(at(style::PANEL_HEAD));
            draw_head(&head, panel)?;
            let time_axis = if i == last { style::TIME_AXIS } else { 0 };
            let (area, below) = below.split_vertically(at(panel.height + time_axis));
            draw_panel(&area, panel, caption, time_axis)?;
            rest = below;
        }
        root.present().map_err(failed)?;
    }
    Ok(in_pixels(&svg, height))
}

/// The drawing is made on a finer grid: its size on the page is told in pixels.
fn in_pixels(svg: &str, height: u32) -> String {
    let fine = format!("width=\"{}\" height=\"{}\"", px(style::WIDTH), px(height));
    let pixels = format!("width=\"{}\" height=\"{height}\"", style::WIDTH);
    svg.replacen(&fine, &pixels, 1)
}

fn draw_caption(area: &Area<'_>, caption: &Caption) -> Result<(), PlotError> {
    let width = style::WIDTH - style::RIGHT - 20;
    let title = style::fitting(&caption.title, style::TITLE, width);
    let about = style::fitting(&caption.about, style::TEXT, width);
    write(area, &title, (20, 22), style::TITLE, style::INK, HPos::Left)?;
    write(area, &about, (20, 46), style::TEXT, style::SOFT_INK, HPos::Left)
}

/// Of an item of a legend: length of the line, room before its text, room after it.
const SAMPLE: u32 = 22;
const GAP: u32 = 6;
const BETWEEN: u32 = 16;

/// The name at the left, the legend at the right.
fn draw_head(area: &Area<'_>, panel: &Panel) -> Result<(), PlotError> {
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
        }
        write(area, text, (x + SAMPLE + GAP, middle), style::TEXT, style::SOFT_INK, HPos::Left)?;
        x += item(text);
    }
    Ok(())
}

fn draw_panel(area: &Area<'_>, panel: &Panel, caption: &Caption, time_axis: u32) -> Result<(), PlotError> {
    let times = caption.range.clone();
    let mut chart = ChartBuilder::on(area)
        .set_label_area_size(LabelAreaPosition::Left, px(style::LEFT))
        .set_label_area_size(LabelAreaPosition::Bottom, px(time_axis))
        .margin_right(px(style::RIGHT))
        .build_cartesian_2d(times.clone(), panel.range.clone())
        .map_err(failed)?;
    let (bottom, top) = (panel.range.start, panel.range.end);
    // Behind the grid, and a pixel wide at least.
    let pixel = (times.end - times.start) / f64::from(style::WIDTH - style::LEFT - style::RIGHT);
    let areas = panel.spans.iter().map(|span| {
        let corners = [(span.from, bottom), (span.to.max(span.from + pixel).min(times.end), top)];
        Rectangle::new(corners, stroke(span.state.look()))
    });
    chart.draw_series(areas).map_err(failed)?;
    let numbers = ("sans-serif", style::text_size(style::TEXT)).into_font().color(&style::SOFT_INK);
    let value_digits = style::digits(panel.range.end - panel.range.start);
    let time_digits = style::digits(times.end - times.start);
    let values = |value: &f64| style::number(*value, value_digits);
    let seconds = |value: &f64| style::number(*value, time_digits);
    let mut mesh = chart.configure_mesh();
    mesh.x_labels(12)
        .y_labels((panel.height / 24) as usize)
        .max_light_lines(0)
        .bold_line_style(style::GRID.stroke_width(px(1)))
        .axis_style(style::FRAME.stroke_width(px(1)))
        .label_style(numbers.clone())
        .x_label_formatter(&seconds)
        .y_label_formatter(&values)
        .set_tick_mark_size(LabelAreaPosition::Left, px(4))
        .set_tick_mark_size(LabelAreaPosition::Bottom, px(if time_axis == 0 { 0 } else { 4 }));
    if time_axis > 0 {
        mesh.x_desc(caption.axis).axis_desc_style(numbers.color(&style::INK));
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
        chart.draw_series(pieces.into_iter().map(|piece| PathElement::new(piece.clone(), style))).map_err(failed)?;
        // A line needs two points to be seen.
        let dots = alone.into_iter().flatten().map(|sample| Circle::new(*sample, px(2), style.filled()));
        chart.draw_series(dots).map_err(failed)?;
    }
    draw_notes(area, panel, &times)
}

/// What is to be said of states, at the top of the panel where they begin; what would lie on another note is left out.
fn draw_notes(area: &Area<'_>, panel: &Panel, times: &Range<f64>) -> Result<(), PlotError> {
    let right = style::WIDTH - style::RIGHT;
    let pixels = f64::from(right - style::LEFT) / (times.end - times.start);
    let mut free_from = style::LEFT;
    for span in &panel.spans {
        let Some(note) = &span.note else { continue };
        let width = style::text_width(note, style::TEXT) + GAP;
        let begin = style::LEFT + ((span.from - times.start) * pixels) as u32 + GAP / 2;
        let x = begin.min(right - width);
        if x >= free_from {
            write(area, note, (x, 10), style::TEXT, style::ALARM, HPos::Left)?;
            free_from = x + width;
        }
    }
    Ok(())
}

fn write(
    area: &Area<'_>,
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
        Look::Solid(colour) => ShapeStyle { color: colour.to_rgba(), filled: false, stroke_width: px(3) / 2 },
        Look::Pale(colour) => colour.mix(0.35).stroke_width(px(5)),
        Look::Area(colour) => colour.filled(),
    }
}

fn failed(error: impl Display) -> PlotError {
    PlotError::Draw { reason: error.to_string() }
}
