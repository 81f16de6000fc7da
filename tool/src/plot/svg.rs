//! Draws a picture as SVG.

use plotters::prelude::SVGBackend;

use super::PlotError;
use super::chart::Sheet;
use super::style::{self, px};

/// Draws the picture and returns the text of the file.
pub fn write(sheet: &Sheet) -> Result<String, PlotError> {
    let height = sheet.height();
    let mut svg = String::new();
    sheet.draw(SVGBackend::with_string(&mut svg, (px(style::WIDTH), px(height))))?;
    Ok(in_pixels(&svg, height))
}

/// Sets the size on the page in pixels, because the drawing is made on a finer grid.
fn in_pixels(svg: &str, height: u32) -> String {
    let fine = format!("width=\"{}\" height=\"{}\"", px(style::WIDTH), px(height));
    let pixels = format!("width=\"{}\" height=\"{height}\"", style::WIDTH);
    svg.replacen(&fine, &pixels, 1)
}
