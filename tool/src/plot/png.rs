//! Writes a picture as PNG. It is drawn on a finer grid and scaled down, so that edges are smooth. The grid is drawn in
//! horizontal bands, one after the other, because with many panels the whole grid would take a gigabyte of memory.

use std::convert::Infallible;
use std::io::Write as _;
use std::ops::Range;

use ab_glyph::{Font, FontRef, GlyphId, Point, ScaleFont};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind, FontTransform,
};

use super::PlotError;
use super::chart::Sheet;
use super::style::{self, FINE, px};

/// The font of all texts. It is embedded, so that a picture does not depend on the installed fonts. Its licence is
/// `tool/font/LICENSE.txt`.
static FONT: &[u8] = include_bytes!("../../font/plot.ttf");
/// \[OURS] The number of picture points in the file for each pixel of the page, horizontally and vertically. Two points
/// keep letters sharp on paper and on screens with high resolution.
const POINTS_PER_PIXEL: u32 = 2;
/// The number of grid points for each picture point, horizontally and vertically.
const GRID: u32 = FINE / POINTS_PER_PIXEL;
/// \[OURS] The height of a band in grid rows; a band takes 20 MB.
const BAND_ROWS: u32 = 1024;
/// \[OURS] The resolution that the file states, in picture points per metre: a pixel of the page is 1/96 inch.
const POINTS_PER_METRE: u32 = 96 * POINTS_PER_PIXEL * 10_000 / 254;
/// The drawing library divides a text size by this factor to get the height of an em. This module draws the texts itself,
/// and does the same.
const TEXT_SIZE_PER_EM: f64 = 1.24;
/// The distance from the baseline of a text to its anchor, in ems, for a text that is vertically centred at the anchor:
/// half the height of the letter x. The next constant is for a text that hangs below the anchor: the height of a
/// capital letter.
const HALF_X_HEIGHT_EM: f32 = 0.27;
const CAPITAL: f32 = 0.76;

/// Draws the picture and returns the bytes of the file.
pub fn write(sheet: &Sheet) -> Result<Vec<u8>, PlotError> {
    in_bands(sheet, BAND_ROWS)
}

/// Draws the picture in bands that are `band` grid rows high, a multiple of [`GRID`]. The picture does not depend on `band`.
fn in_bands(sheet: &Sheet, band: u32) -> Result<Vec<u8>, PlotError> {
    let (width, height) = (style::WIDTH, sheet.height());
    let font = FontRef::try_from_slice(FONT).map_err(failed)?;
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width * POINTS_PER_PIXEL, height * POINTS_PER_PIXEL);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let density = png::PixelDimensions { xppu: POINTS_PER_METRE, yppu: POINTS_PER_METRE, unit: png::Unit::Meter };
    encoder.set_pixel_dims(Some(density));
    let mut writer = encoder.write_header().map_err(failed)?;
    let mut points = writer.stream_writer().map_err(failed)?;
    let mut canvas = Canvas::new(px(width), px(height), font);
    for top in (0..px(height)).step_by(band as usize) {
        canvas.begin(top..px(height).min(top + band));
        sheet.draw(&mut canvas)?;
        points.write_all(&canvas.smaller()).map_err(failed)?;
    }
    points.finish().map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(file)
}

fn failed(error: impl ToString) -> PlotError {
    PlotError::Draw { reason: error.to_string() }
}

/// The backend of the drawing library that draws on the grid.
struct Canvas {
    width: u32,
    height: u32,
    /// The grid rows of the present band. Everything outside the band is not drawn.
    band: Range<u32>,
    /// The grid points of the band as 0x00RRGGBB, row by row from the top.
    points: Vec<u32>,
    /// The indexes of the grid points that the present line covers. The next field has a bit for each grid point of the
    /// band, set for these points. So each point is coloured once, and the line is not darker where it crosses itself.
    covered: Vec<u32>,
    is_covered: Vec<u64>,
    font: FontRef<'static>,
}

impl Canvas {
    fn new(width: u32, height: u32, font: FontRef<'static>) -> Self {
        Self { width, height, band: 0..0, points: Vec::new(), covered: Vec::new(), is_covered: Vec::new(), font }
    }

    /// Begins a band with these grid rows, all white.
    fn begin(&mut self, band: Range<u32>) {
        let count = self.width as usize * band.len();
        self.points.clear();
        self.points.resize(count, packed((0xFF, 0xFF, 0xFF)));
        self.is_covered.resize(count.div_ceil(64), 0);
        self.band = band;
    }

    /// Scales the band down: each picture point gets the mean colour of its grid points. Returns three bytes for each
    /// picture point: red, green, blue.
    fn smaller(&self) -> Vec<u8> {
        const _: () = assert!(GRID == 2, "the mean is that of two by two");
        /// Selects red and blue, with zeros between them, so that both are summed in one addition. Green is summed separately.
        const APART: u32 = 0x00FF_00FF;
        let width = self.width as usize;
        let mut points = Vec::with_capacity(self.points.len() / 4 * 3);
        for rows in self.points.chunks_exact(2 * width) {
            let (above, below) = rows.split_at(width);
            for (a, b) in above.chunks_exact(2).zip(below.chunks_exact(2)) {
                let outer = (a[0] & APART) + (a[1] & APART) + (b[0] & APART) + (b[1] & APART);
                let green = (a[0] >> 8 & 0xFF) + (a[1] >> 8 & 0xFF) + (b[0] >> 8 & 0xFF) + (b[1] >> 8 & 0xFF);
                points.extend([(outer >> 18) as u8, (green >> 2) as u8, (outer >> 2) as u8]);
            }
        }
        points
    }

    fn blend(&mut self, place: usize, colour: BackendColor, part: f64) {
        let part = (colour.alpha * part).clamp(0.0, 1.0);
        let before = self.points[place];
        let mixed =
            |before: u32, new: u8| (f64::from(before & 0xFF) * (1.0 - part) + f64::from(new) * part).round() as u8;
        let (red, green, blue) = colour.rgb;
        self.points[place] = packed((mixed(before >> 16, red), mixed(before >> 8, green), mixed(before, blue)));
    }

    fn place(&self, x: i64, y: i64) -> Option<u32> {
        let rows = i64::from(self.band.start)..i64::from(self.band.end);
        let inside = (0..i64::from(self.width)).contains(&x) && rows.contains(&y);
        inside.then(|| (y as u32 - self.band.start) * self.width + x as u32)
    }

    /// Marks the grid points whose distance from the line between two points is at most half the line width.
    fn cover(&mut self, (x0, y0): BackendCoord, (x1, y1): BackendCoord, width: u32) {
        let (from, to) = ((f64::from(x0), f64::from(y0)), (f64::from(x1), f64::from(y1)));
        let half = f64::from(width.max(1)) / 2.0;
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let length = dx.hypot(dy);
        let (top, bottom) = ((from.1.min(to.1) - half).floor() as i64, (from.1.max(to.1) + half).ceil() as i64);
        for y in top.max(self.band.start.into())..=bottom.min(i64::from(self.band.end) - 1) {
            let middle = y as f64 + 0.5;
            // Only columns near this row's part of the line are searched, because most of a long flat line is far away
            // from the row.
            let (least, most) = if dy.abs() < 1e-9 {
                (from.0.min(to.0), from.0.max(to.0))
            } else {
                let along = |y: f64| from.0 + ((y - from.1) / dy).clamp(0.0, 1.0) * dx;
                let (a, b) = (along(middle - half - 1.0), along(middle + half + 1.0));
                (a.min(b), a.max(b))
            };
            for x in (least - half - 1.0).floor() as i64..=(most + half + 1.0).ceil() as i64 {
                let (px, py) = (x as f64 + 0.5 - from.0, middle - from.1);
                let along = if length > 0.0 { ((px * dx + py * dy) / (length * length)).clamp(0.0, 1.0) } else { 0.0 };
                if (px - along * dx).hypot(py - along * dy) <= half {
                    let Some(place) = self.place(x, y) else { continue };
                    let (word, bit) = (&mut self.is_covered[place as usize / 64], 1 << (place % 64));
                    if *word & bit == 0 {
                        *word |= bit;
                        self.covered.push(place);
                    }
                }
            }
        }
    }

    /// Colours the covered grid points.
    fn fill_covered(&mut self, colour: BackendColor) {
        let mut covered = std::mem::take(&mut self.covered);
        for place in covered.drain(..) {
            self.is_covered[place as usize / 64] = 0;
            self.blend(place as usize, colour, 1.0);
        }
        self.covered = covered;
    }
}

const fn packed((red, green, blue): (u8, u8, u8)) -> u32 {
    (red as u32) << 16 | (green as u32) << 8 | blue as u32
}

type Done = Result<(), DrawingErrorKind<Infallible>>;

impl DrawingBackend for &mut Canvas {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn ensure_prepared(&mut self) -> Done {
        Ok(())
    }

    fn present(&mut self) -> Done {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, colour: BackendColor) -> Done {
        if let Some(place) = self.place(x.into(), y.into()) {
            self.blend(place as usize, colour, 1.0);
        }
        Ok(())
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Done {
        self.cover(from, to, style.stroke_width());
        self.fill_covered(style.color());
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(&mut self, path: I, style: &S) -> Done {
        let mut before = None;
        for point in path {
            if let Some(before) = before.replace(point) {
                self.cover(before, point, style.stroke_width());
            }
        }
        self.fill_covered(style.color());
        Ok(())
    }

    fn draw_rect<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S, fill: bool) -> Done {
        let (left, right) = (from.0.min(to.0), from.0.max(to.0));
        let (top, bottom) = (from.1.min(to.1), from.1.max(to.1));
        if !fill {
            let corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)];
            return self.draw_path(corners, style);
        }
        // The areas of a plot are opaque, so nothing is blended.
        let (left, right) = (left.max(0) as usize, (right + 1).clamp(0, self.width as i32) as usize);
        let row = |y: i32| y.clamp(self.band.start as i32, self.band.end as i32) as usize - self.band.start as usize;
        let (top, bottom) = (row(top), row(bottom + 1));
        for row in self.points.chunks_exact_mut(self.width as usize).take(bottom).skip(top) {
            if let Some(row) = row.get_mut(left..right) {
                row.fill(packed(style.color().rgb));
            }
        }
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(&mut self, at: BackendCoord, radius: u32, style: &S, _fill: bool) -> Done {
        self.cover(at, at, 2 * radius);
        self.fill_covered(style.color());
        Ok(())
    }

    /// Places the text where [`plotters::prelude::SVGBackend`] places it.
    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Done {
        debug_assert!(matches!(style.transform(), FontTransform::None), "no text of a plot stands upright");
        let em = (style.size() / TEXT_SIZE_PER_EM) as f32;
        // No letter reaches further than this from the text's position, so a text outside of the band is skipped.
        let (above, below) = (at.1 as f32 - 2.0 * em, at.1 as f32 + 2.0 * em);
        if below < self.band.start as f32 || above > self.band.end as f32 {
            return Ok(());
        }
        // The font library's scale is the height from the lowest to the highest letter.
        let units = self.font.units_per_em().unwrap_or(1000.0);
        let scale = em * self.font.height_unscaled() / units;
        let font = self.font.clone();
        let scaled = font.as_scaled(scale);
        // A character that the font does not have is drawn as the replacement character.
        let glyph = |letter: char| match scaled.glyph_id(letter) {
            GlyphId(0) => scaled.glyph_id('\u{FFFD}'),
            known => known,
        };
        let width: f32 = text.chars().map(|letter| scaled.h_advance(glyph(letter))).sum();
        let mut x = at.0 as f32
            - match style.anchor().h_pos {
                HPos::Left => 0.0,
                HPos::Right => width,
                HPos::Center => width / 2.0,
            };
        let baseline = at.1 as f32
            + em * match style.anchor().v_pos {
                VPos::Top => CAPITAL,
                VPos::Center => HALF_X_HEIGHT_EM,
                VPos::Bottom => -HALF_X_HEIGHT_EM,
            };
        for letter in text.chars() {
            let id = glyph(letter);
            let placed = id.with_scale_and_position(scale, Point { x, y: baseline });
            x += scaled.h_advance(id);
            let Some(outline) = font.outline_glyph(placed) else { continue };
            let bounds = outline.px_bounds();
            outline.draw(|dx, dy, part| {
                let place = self.place(bounds.min.x as i64 + i64::from(dx), bounds.min.y as i64 + i64::from(dy));
                if let Some(place) = place {
                    self.blend(place as usize, style.color(), part.into());
                }
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::chart::Caption;
    use crate::plot::panel::{Look, Panel, Stroke};

    /// A sheet with this number of panels, each with lines, texts and areas.
    fn sheet(panels: usize) -> Sheet {
        let up = vec![vec![(0.0, -1.0), (0.5, 1.0), (1.0, -1.0)], vec![(0.2, 0.0)]];
        let panel = |n: usize| Panel {
            name: format!("Panel {n} of gyÅ"),
            height: 190,
            range: -1.2..1.2,
            strokes: vec![
                Stroke { pieces: up.clone(), look: Look::Pale(style::OUTPUT) },
                Stroke { pieces: up.clone(), look: Look::Solid(style::INPUT) },
            ],
            marks: vec![0.7],
            legend: vec![(Look::Area(style::FAULT), "fault".into())],
            ..Panel::default()
        };
        let (title, about) = ("Title".to_owned(), "about".to_owned());
        let caption = Caption { title, about, range: 0.0..1.0, axis: "time (s)" };
        Sheet { panels: (0..panels).map(panel).collect(), caption }
    }

    fn points(file: &[u8]) -> Vec<u8> {
        let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().unwrap();
        let mut points = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut points).unwrap();
        points
    }

    /// The picture does not depend on the height of the bands, even if the end of a band cuts a letter.
    #[test]
    fn a_picture_is_the_same_whatever_bands_it_is_drawn_in() {
        let sheet = sheet(1);
        let whole = points(&in_bands(&sheet, px(sheet.height())).unwrap());
        let colours = |points: &[u8]| points.chunks_exact(3).filter(|point| *point != [0xFF; 3]).count();
        assert!(colours(&whole) > 10_000, "{}", colours(&whole));
        for band in [302, BAND_ROWS] {
            assert!(points(&in_bands(&sheet, band).unwrap()) == whole, "bands of {band}");
        }
    }

    /// Drawing needs memory for one band only, however high the picture is.
    #[test]
    fn a_picture_takes_as_much_memory_as_one_band_however_high_it_is() {
        let sheet = sheet(3);
        let grid = u64::from(px(style::WIDTH)) * u64::from(px(sheet.height())) * 4;
        let taken = allocation_counter::measure(|| assert!(!write(&sheet).unwrap().is_empty())).bytes_max;
        assert!(grid > 50_000_000 && taken < 40_000_000, "{taken} bytes for a grid of {grid}");
    }
}
